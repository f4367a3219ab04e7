#include "octobrick/codec/s3dc_sampler.h"

#include <algorithm>
#include <cstdint>

#include "interpolation.h"
#include "rows.h"
#include "s3dc_access.h"
#include "s3dc_check.h"
#include "simd.h"
#include "store_vector.h"

namespace octobrick::codec {
namespace detail {
namespace {

template <class T>
class Sampler final : public S3dcSampler {
  public:
    Sampler(const S3dc& codec, Zyx shape, const Layout& layout, const std::byte* code, bool simd)
        : codec_(codec),
          shape_(shape),
          layout_(layout),
          code_(code),
          axes_(shape),
          access_(codec, shape, layout, code),
          bits_(simd && has_avx2()) {}

    void sample(Sampling how, SamplePoints points, float* out) const override {
        points.visit([&](const auto* xyz) {
            bits_ ? sample_with_bits(how, xyz, points.size(), out)
                  : sample_all(access_, how, xyz, points.size(), out);
        });
    }

    void gradient(Sampling how, SamplePoints points, const double (&spacing_zyx)[3],
                  float* out) const override {
        const double scale_xyz[3] = {0.5 / spacing_zyx[2], 0.5 / spacing_zyx[1],
                                     0.5 / spacing_zyx[0]};
        points.visit([&](const auto* xyz) {
            bits_ ? gradient_with_bits(how, xyz, points.size(), scale_xyz, out)
                  : gradient_all(how, xyz, points.size(), scale_xyz, out);
        });
    }

    S3dcFetches count_fetches(Sampling how, SamplePoints points) const override {
        S3dcFetches sum;
        const S3dcAccess<T, CountFetches> access(codec_, shape_, layout_, code_, {&sum});
        points.visit([&](const auto* xyz) {
            float room[kTogether];
            for (std::size_t k = 0; k < points.size(); k += kTogether) {
                const std::size_t n = std::min(kTogether, points.size() - k);
                sample_all(access, how, xyz + 3 * k, n, room);
            }
        });
        return sum;
    }

  private:
    // The same bodies twice: see simd.h.
    template <class P>
    OCTOBRICK_BITS_TARGET void sample_with_bits(Sampling how, const P* xyz, std::size_t n,
                                                float* out) const {
        sample_all(access_, how, xyz, n, out);
    }
    template <class P>
    OCTOBRICK_BITS_TARGET void gradient_with_bits(Sampling how, const P* xyz, std::size_t n,
                                                  const double (&scale_xyz)[3], float* out) const {
        gradient_all(how, xyz, n, scale_xyz, out);
    }

    template <class Access, class P>
    void sample_all(const Access& access, Sampling how, const P* xyz, std::size_t n,
                    float* out) const {
        switch (how) {
            case Sampling::nearest: sample_points<NearestOf>(access, axes_, xyz, n, out); break;
            case Sampling::trilinear: sample_points<TrilinearOf>(access, axes_, xyz, n, out); break;
            case Sampling::trilinear_shared:
                sample_points<TrilinearSharedOf>(access, axes_, xyz, n, out);
        }
    }

    template <class P>
    void gradient_all(Sampling how, const P* xyz, std::size_t n, const double (&scale_xyz)[3],
                      float* out) const {
        for (std::size_t k = 0; k < n; k += kTogether) {
            const std::size_t some = std::min(kTogether, n - k);
            how == Sampling::trilinear
                ? gradient_some<TrilinearOf>(xyz + 3 * k, some, scale_xyz, out + 3 * k)
                : gradient_some<TrilinearSharedOf>(xyz + 3 * k, some, scale_xyz, out + 3 * k);
        }
    }

    template <template <class> class How, class P>
    void gradient_some(const P* xyz, std::size_t n, const double (&scale_xyz)[3],
                       float* out) const {
        double slopes[3][kTogether];
        for (int axis = 0; axis < 3; ++axis) {
            double* slope = slopes[axis];
            DoubleFour ahead = {};
            ahead[axis] = 1;
            sample_some<How>(access_, axes_, xyz, n, ahead,
                             [=](std::size_t k, double sample) { slope[k] = sample; });
            sample_some<How>(access_, axes_, xyz, n, -ahead, [&](std::size_t k, double sample) {
                slope[k] = (slope[k] - sample) * scale_xyz[axis];
            });
        }
        for (std::size_t k = 0; k < n; ++k) {
            store_vector(slopes[0][k], slopes[1][k], slopes[2][k], out + 3 * k);
        }
    }

    S3dc codec_;
    Zyx shape_;
    Layout layout_;
    const std::byte* code_;
    SampleAxes axes_;
    S3dcAccess<T, IgnoreFetches> access_;
    bool bits_;  // all processors that have AVX2 have these instructions
};

}  // namespace
}  // namespace detail

Outcome S3dcSampler::open(const S3dc& codec, SampleType type, Zyx shape,
                          std::span<const std::byte> code, std::unique_ptr<S3dcSampler>& sampler,
                          bool simd) {
    if (codec.scaled) return {Status::bad_scales, {}, 0, 0};
    Layout layout;
    const Outcome outcome = detail::check_code(codec, type, shape, code, layout);
    if (std::max({shape.z, shape.y, shape.x}) > INT32_MAX) return {Status::too_large, {}, 0, 0};
    if (outcome.status == Status::ok) {
        sampler = detail::with_sample_type(type, [&]<class T>(T) -> std::unique_ptr<S3dcSampler> {
            return std::make_unique<detail::Sampler<T>>(codec, shape, layout, code.data(), simd);
        });
    }
    return outcome;
}

}  // namespace octobrick::codec
