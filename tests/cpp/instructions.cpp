// Generated volumes of every type and size, computed with each set of instructions that this
// machine has: the results have the same bits.

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "check.h"

namespace {

using namespace octobrick::codec;

std::mt19937 generator(1);  // the same numbers on every machine

std::size_t below(std::size_t end) { return generator() % end; }

// Any bits at all, of any magnitude; floats are finite.
Bytes any_samples(SampleType type, std::size_t count) {
    Bytes bytes(count * sample_nbytes(type));
    for (std::byte& b : bytes) b = static_cast<std::byte>(generator() >> 24);
    for (std::size_t at = 0; type == SampleType::f32 && at < bytes.size(); at += sizeof(float)) {
        float value;
        std::memcpy(&value, &bytes[at], sizeof value);
        if (!std::isfinite(value)) std::memset(&bytes[at], 0, sizeof value);
    }
    return bytes;
}

// Every execution makes the same bytes.
template <class Compute>
void same_bytes(const Compute& compute) {
    const Bytes plain = compute(kExecutions[0]);
    for (const Execution& execution : kExecutions) CHECK(compute(execution) == plain);
}

template <class T>
Bytes bytes_of(const T& value) {
    const auto* from = reinterpret_cast<const std::byte*>(&value);
    return {from, from + sizeof value};
}

void check_volume(SampleType type, unsigned bits) {
    const Zyx shape = {1 + below(5), 1 + below(5), 1 + below(200)};
    const std::size_t nbytes = shape.z * shape.y * shape.x * sample_nbytes(type);
    const S3dc codec{{1 + below(4), 1 + below(4), 1 + below(70)}, bits};
    Layout layout;
    CHECK(make_layout(codec, type, shape, layout) == Status::ok);
    const Bytes samples = any_samples(type, shape.z * shape.y * shape.x);
    const auto voxels = packed<ConstVolume>(samples.data(), type, shape);

    Bytes decoded(nbytes);
    same_bytes([&](Execution execution) {
        Bytes code(layout.nbytes);
        CHECK(encode(codec, voxels, code, execution).status == Status::ok);
        const auto out = packed<Volume>(decoded.data(), type, shape);
        CHECK(decode(codec, code, out, execution).status == Status::ok);
        code.insert(code.end(), decoded.begin(), decoded.end());
        return code;
    });
    same_bytes([&](Execution execution) {
        const Zyx half = half_shape(shape);
        Bytes coarse(half.z * half.y * half.x * sample_nbytes(type));
        CHECK(mean2(voxels, packed<Volume>(coarse.data(), type, half), execution));
        return coarse;
    });
    same_bytes([&](Execution execution) {
        ErrorStats stats;
        CHECK(compare(voxels, packed<ConstVolume>(decoded.data(), type, shape), stats, execution));
        return bytes_of(stats);
    });
}

void check_directions() {
    std::vector<float> vectors(3 * (1 + below(700)));
    const Bytes bytes = any_samples(SampleType::f32, vectors.size());
    std::memcpy(vectors.data(), bytes.data(), bytes.size());
    same_bytes([&](Execution execution) {
        std::vector<std::uint8_t> codes(vectors.size());
        CHECK(encode_directions(std::span<const float>(vectors), codes, execution) == kAllFinite);
        std::vector<float> decoded(vectors.size());
        decode_directions(codes, decoded, execution);
        Bytes both(codes.size() * (1 + sizeof(float)));
        std::memcpy(both.data(), codes.data(), codes.size());
        std::memcpy(&both[codes.size()], decoded.data(), codes.size() * sizeof(float));
        return both;
    });
}

void check_deblock() {
    const Zyx shape = {1 + below(12), 1 + below(12), 1 + below(24)};
    std::vector<float> volume(shape.z * shape.y * shape.x);
    for (float& v : volume) v = static_cast<float>(generator() % 1000);
    Deblock filter;
    filter.block = {1 + below(5), 1 + below(5), 1 + below(9)};
    same_bytes([&](Execution execution) {
        Bytes out(volume.size() * sizeof(float));
        std::vector<float> smooth(volume.size());
        CHECK(deblock(filter, volume, shape, {}, smooth, execution) == kAllFinite);
        std::memcpy(out.data(), smooth.data(), out.size());
        return out;
    });
}

}  // namespace

int main() {
    constexpr int kRounds = 100;
    for (int round = 0; round < kRounds; ++round) {
        for (unsigned type = 0; type < 5; ++type) {
            for (unsigned bits = 1; bits <= 8; ++bits) {
                check_volume(static_cast<SampleType>(type), bits);
            }
        }
        check_directions();
        check_deblock();
    }
    std::printf("%d rounds of all types and bits: the same on %zu paths\n", kRounds,
                std::size(kExecutions));
}
