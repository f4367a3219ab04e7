// What fuzz targets of codes that can be sampled share.
#pragma once

#include <algorithm>
#include <cstring>
#include <limits>
#include <span>

#include "fuzz.h"
#include "octobrick/codec/s3dc_sampler.h"

namespace octobrick::fuzz {

// Any bits are a point. All ways and both paths must agree, and only NaN may give NaN.
inline void sample_everywhere(const codec::S3dcSampler& sampler, const codec::S3dcSampler& scalar,
                              std::span<const std::byte> bits, codec::Zyx shape) {
    using namespace codec;
    const auto last = static_cast<float>(shape.x);
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    float xyz[12] = {0,
                     0,
                     0,
                     last,
                     static_cast<float>(shape.y),
                     static_cast<float>(shape.z),
                     kInfinity,
                     -kInfinity,
                     0,
                     last - 0.75f,
                     0.75f,
                     0.75f};
    std::memcpy(xyz, bits.data(), std::min<std::size_t>(bits.size(), 3 * sizeof(float)));
    const SamplePoints points{std::span<const float>(xyz)};
    float found[4][4];
    sampler.sample(Sampling::trilinear, points, found[0]);
    sampler.sample(Sampling::trilinear_shared, points, found[1]);
    scalar.sample(Sampling::trilinear, points, found[2]);
    scalar.sample(Sampling::trilinear_shared, points, found[3]);
    for (int k = 0; k < 4; ++k) {
        const float* p = xyz + 3 * k;
        const bool is_nan = p[0] != p[0] || p[1] != p[1] || p[2] != p[2];
        for (int way = 0; way < 4; ++way) {
            const float one = found[way][k];
            REQUIRE(is_nan ? one != one : one == found[0][k]);
        }
    }
    float nearest[4], gradient[12];
    sampler.sample(Sampling::nearest, points, nearest);
    scalar.gradient(Sampling::trilinear_shared, points, {1, 1, 1}, gradient);
    sampler.gradient(Sampling::trilinear_shared, points, {1, 1, 1}, gradient);
    sampler.count_fetches(Sampling::trilinear_shared, points);
}

}  // namespace octobrick::fuzz
