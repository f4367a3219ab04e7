// Hostile codes: whatever the bytes, decode() ends with a status, touches nothing that is not its
// own, and says the same with every set of instructions. What it accepts is finite: it can be
// encoded again, and sampled anywhere.
//
// The first 8 bytes choose the parameters, the rest is the code.

#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>

#include "fuzz.h"
#include "octobrick/codec/s3dc.h"
#include "octobrick/codec/s3dc_sampler.h"

namespace {

using namespace octobrick::codec;

using Block = octobrick::fuzz::Exact<std::byte>;

Volume packed_volume(std::byte* origin, SampleType type, Zyx shape) {
    const auto unit = static_cast<std::ptrdiff_t>(sample_nbytes(type));
    const auto row = unit * static_cast<std::ptrdiff_t>(shape.x);
    return {origin, type, shape, {row * static_cast<std::ptrdiff_t>(shape.y), row, unit}};
}

// Any bits are a point. All ways and both paths must agree, and only NaN may give NaN.
void sample_everywhere(const S3dcSampler& sampler, const S3dcSampler& scalar,
                       std::span<const std::byte> bits, Zyx shape) {
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
            REQUIRE(is_nan ? found[way][k] != found[way][k] : found[way][k] == found[0][k]);
        }
    }
    float nearest[4], gradient[12];
    sampler.sample(Sampling::nearest, points, nearest);
    scalar.gradient(Sampling::trilinear_shared, points, {1, 1, 1}, gradient);
    sampler.gradient(Sampling::trilinear_shared, points, {1, 1, 1}, gradient);
    sampler.count_fetches(Sampling::trilinear_shared, points);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    constexpr std::size_t kParameters = 8;
    if (size < kParameters) {
        return 0;
    }
    const auto type = static_cast<SampleType>(data[0] % 5);
    const Zyx shape = {data[1] % 6u, data[2] % 6u, data[3] % 150u};
    const S3dc codec = {{data[4] % 9u, data[5] % 9u, data[6] % 70u}, data[7] % 10u};

    Layout layout;
    if (make_layout(codec, type, shape, layout) != Status::ok) {
        return 0;
    }
    // A short input is continued with zeros, so that small inputs get past the size check.
    const std::size_t given = size - kParameters;
    const bool wrong_size = given > layout.nbytes;
    const std::size_t code_nbytes = wrong_size ? given : layout.nbytes;
    const Block code(code_nbytes);
    std::memcpy(code.data(), data + kParameters, given);

    const std::size_t voxels_nbytes = shape.z * shape.y * shape.x * sample_nbytes(type);
    const Block first(voxels_nbytes);
    const Volume voxels = packed_volume(first.data(), type, shape);
    const Outcome outcome = decode(codec, code.span(), voxels);
    REQUIRE(!wrong_size || outcome.status == Status::wrong_nbytes);
    for (const Execution execution : octobrick::fuzz::kExecutions) {
        const Block second(voxels_nbytes);
        const Volume same = packed_volume(second.data(), type, shape);
        const Outcome other = decode(codec, code.span(), same, execution);
        REQUIRE(outcome.status == other.status && outcome.at == other.at);
        REQUIRE(outcome.status != Status::ok ||
                std::memcmp(first.data(), second.data(), voxels_nbytes) == 0);
    }
    std::unique_ptr<S3dcSampler> sampler, scalar_sampler;
    const Outcome opened = S3dcSampler::open(codec, type, shape, code.span(), sampler);
    REQUIRE(opened.status == outcome.status && opened.at == outcome.at);
    S3dcSampler::open(codec, type, shape, code.span(), scalar_sampler, false);
    if (outcome.status != Status::ok) {
        return 0;
    }

    sample_everywhere(*sampler, *scalar_sampler, code.span(), shape);

    // What was accepted is finite, so it can be encoded again.
    const Block again(layout.nbytes);
    const ConstVolume decoded{voxels.origin, type, shape, voxels.strides};
    REQUIRE(encode(codec, decoded, again.span()).status == Status::ok);
    return 0;
}
