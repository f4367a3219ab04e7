// Hostile codes: whatever the bytes, decode() ends with a status, touches nothing that is not its
// own, and says the same with every set of instructions. What it accepts is finite: it can be
// encoded again, and sampled anywhere.
//
// The first 8 bytes choose the parameters, the rest is the code.

#include <algorithm>
#include <cstring>
#include <memory>

#include "fuzz.h"
#include "octobrick/codec/s3dc.h"
#include "octobrick/codec/s3dc_sampler.h"
#include "sample_everywhere.h"

namespace {

using namespace octobrick::codec;

using Block = octobrick::fuzz::Exact<std::byte>;

Volume packed_volume(std::byte* origin, SampleType type, Zyx shape) {
    const auto unit = static_cast<std::ptrdiff_t>(sample_nbytes(type));
    const auto row = unit * static_cast<std::ptrdiff_t>(shape.x);
    return {origin, type, shape, {row * static_cast<std::ptrdiff_t>(shape.y), row, unit}};
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

    octobrick::fuzz::sample_everywhere(*sampler, *scalar_sampler, code.span(), shape);

    // What was accepted is finite, so it can be encoded again.
    const Block again(layout.nbytes);
    const ConstVolume decoded{voxels.origin, type, shape, voxels.strides};
    REQUIRE(encode(codec, decoded, again.span()).status == Status::ok);
    return 0;
}
