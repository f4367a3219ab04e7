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
        for_some(points, [&](const DoubleFour* some, std::size_t first, std::size_t n) {
            bits_ ? sample_with_bits(how, some, n, out + first)
                  : sample_now(access_, how, some, n, out + first);
        });
    }

    void gradient(Sampling how, SamplePoints points, const double (&spacing_zyx)[3],
                  float* out) const override {
        const double scale_xyz[3] = {0.5 / spacing_zyx[2], 0.5 / spacing_zyx[1],
                                     0.5 / spacing_zyx[0]};
        for_some(points, [&](const DoubleFour* some, std::size_t first, std::size_t n) {
            bits_ ? gradient_with_bits(how, some, n, scale_xyz, out + 3 * first)
                  : gradient_now(how, some, n, scale_xyz, out + 3 * first);
        });
    }

    S3dcFetches count_fetches(Sampling how, SamplePoints points) const override {
        S3dcFetches sum;
        const typename Code::template Access<T, CountFetches> access(code_, {&sum});
        for_some(points, [&](const DoubleFour* some, std::size_t, std::size_t n) {
            float room[kTogether];
            sample_now(access, how, some, n, room);
        });
        return sum;
    }

  private:
    // Calls f(points, number of the first, how many) for no more than kTogether at a time.
    template <class F>
    void for_some(const SamplePoints& points, const F& f) const {
        points.visit([&](const auto* xyz) {
            DoubleFour some[kTogether];
            for (std::size_t first = 0; first < points.size(); first += kTogether) {
                const std::size_t n = std::min(kTogether, points.size() - first);
                bits_ ? load_with_bits(xyz + 3 * first, n, some)
                      : load_points(xyz + 3 * first, n, some);
                f(some, first, n);
            }
        });
    }

    // The same bodies twice: see simd.h. Points are stored as wide as they are loaded afterwards,
    // or each load would wait for two stores.
    template <class P>
    OCTOBRICK_BITS_TARGET static void load_with_bits(const P* xyz, std::size_t n,
                                                     DoubleFour* points) {
        load_points(xyz, n, points);
    }
    OCTOBRICK_BITS_TARGET void sample_with_bits(Sampling how, const DoubleFour* points,
                                                std::size_t n, float* out) const {
        sample_now(access_, how, points, n, out);
    }
    OCTOBRICK_BITS_TARGET void gradient_with_bits(Sampling how, const DoubleFour* points,
                                                  std::size_t n, const double (&scale_xyz)[3],
                                                  float* out) const {
        gradient_now(how, points, n, scale_xyz, out);
    }

    template <class Access>
    void sample_now(const Access& access, Sampling how, const DoubleFour* points, std::size_t n,
                    float* out) const {
        switch (how) {
            case Sampling::nearest: return sample_points<NearestOf>(access, axes_, points, n, out);
            case Sampling::trilinear:
                return sample_points<TrilinearOf>(access, axes_, points, n, out);
            case Sampling::trilinear_shared:
                return sample_points<TrilinearSharedOf>(access, axes_, points, n, out);
        }
    }

    void gradient_now(Sampling how, const DoubleFour* points, std::size_t n,
                      const double (&scale_xyz)[3], float* out) const {
        how == Sampling::trilinear ? gradient_of<TrilinearOf>(points, n, scale_xyz, out)
                                   : gradient_of<TrilinearSharedOf>(points, n, scale_xyz, out);
    }

    template <template <class> class How>
    void gradient_of(const DoubleFour* points, std::size_t n, const double (&scale_xyz)[3],
                     float* out) const {
        double samples[6][kTogether];  // ahead and back, along x, y and z
        for (int way = 0; way < 6; ++way) {
            double* to = samples[way];
            DoubleFour moved = {};
            moved[way / 2] = way % 2 == 0 ? 1 : -1;
            sample_some<How>(access_, axes_, points, n, moved,
                             [to](std::size_t k, double sample) { to[k] = sample; });
        }
        for (std::size_t k = 0; k < n; ++k) {
            double slope[3];
            for (int axis = 0; axis < 3; ++axis) {
                slope[axis] = (samples[2 * axis][k] - samples[2 * axis + 1][k]) * scale_xyz[axis];
            }
            store_vector(slope[0], slope[1], slope[2], out + 3 * k);
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
