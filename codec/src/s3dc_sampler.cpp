#include "octobrick/codec/s3dc_sampler.h"

#include <algorithm>
#include <cstdint>

#include "interpolation.h"
#include "rows.h"
#include "s3dc_access.h"
#include "s3dc_check.h"
#include "s3dc_variable_check.h"
#include "simd.h"
#include "store_vector.h"
#include "variable_access.h"

namespace octobrick::codec {
namespace detail {
namespace {

// Code is FixedCode or VariableCode, with samples of type T.
template <class T, class Code>
class Sampler final : public S3dcSampler {
  public:
    Sampler(const Code& code, bool simd)
        : code_(code), axes_(code.shape), access_(code), bits_(simd && has_avx2()) {}

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
        const typename Code::template Access<T, CountFetches> access(code_, {&sum});
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

    Code code_;
    SampleAxes axes_;
    typename Code::template Access<T, IgnoreFetches> access_;
    bool bits_;  // all processors that have AVX2 have these instructions
};

template <class Code>
std::unique_ptr<S3dcSampler> make_sampler(const Code& code, SampleType type, bool simd) {
    return with_sample_type(type, [&]<class T>(T) -> std::unique_ptr<S3dcSampler> {
        return std::make_unique<Sampler<T, Code>>(code, simd);
    });
}

bool too_long(Zyx shape) { return std::max({shape.z, shape.y, shape.x}) > INT32_MAX; }

}  // namespace
}  // namespace detail

Outcome S3dcSampler::open(const S3dc& codec, SampleType type, Zyx shape,
                          std::span<const std::byte> code, std::unique_ptr<S3dcSampler>& sampler,
                          bool simd) {
    if (codec.scaled) return {Status::bad_scales, {}, 0, 0};
    Layout layout;
    const Outcome outcome = detail::check_code(codec, type, shape, code, layout);
    if (detail::too_long(shape)) return {Status::too_large, {}, 0, 0};
    if (outcome.status == Status::ok) {
        sampler =
            detail::make_sampler(detail::FixedCode{codec, layout, shape, code.data()}, type, simd);
    }
    return outcome;
}

Outcome S3dcSampler::open_variable(Zyx block, SampleType type, Zyx shape,
                                   std::span<const std::byte> code,
                                   std::unique_ptr<S3dcSampler>& sampler, bool simd) {
    VariableLayout layout;
    const Status status = make_variable_layout(block, type, shape, false, layout);
    if (status != Status::ok) return {status, {}, 0, 0};
    if (detail::too_long(shape)) return {Status::too_large, {}, 0, 0};
    const Outcome outcome = detail::check_variable_code(layout, type, shape, code);
    if (outcome.status == Status::ok) {
        sampler = detail::make_sampler(detail::VariableCode{layout, type, shape, code}, type, simd);
    }
    return outcome;
}

}  // namespace octobrick::codec
