// Any bytes are a code of directions: each decodes to a unit vector or to zero. Any floats are
// vectors: each is encoded, to a direction near its own, or found not to be finite.

#include <cmath>
#include <cstring>

#include "fuzz.h"
#include "octobrick/codec/gradients.h"

namespace {

using namespace octobrick::codec;
using octobrick::fuzz::Exact, octobrick::fuzz::kExecutions;

double length(const float* v) {
    return std::sqrt(double{v[0]} * v[0] + double{v[1]} * v[1] + double{v[2]} * v[2]);
}

Exact<float> decoded(const Exact<std::uint8_t>& codes) {
    const std::size_t count = codes.span().size();
    Exact<float> vectors(count);
    decode_directions(codes.span(), vectors.span());
    for (const Execution execution : kExecutions) {
        Exact<float> same(count);
        decode_directions(codes.span(), same.span(), execution);
        REQUIRE(std::memcmp(vectors.data(), same.data(), count * sizeof(float)) == 0);
    }
    for (std::size_t i = 0; i < count; i += 3) {
        const double found = length(&vectors[i]);
        REQUIRE(found == 0 || std::fabs(found - 1) < 1e-6);
    }
    return vectors;
}

void encode_any(std::span<const std::uint8_t> bytes) {
    const std::size_t count = bytes.size() / (3 * sizeof(float)) * 3;
    Exact<float> vectors(count);
    if (count > 0) std::memcpy(vectors.data(), bytes.data(), count * sizeof(float));
    std::size_t first = 0;
    while (first < count && std::isfinite(vectors[first])) ++first;
    const std::size_t expected = first < count ? first / 3 : kAllFinite;

    Exact<std::uint8_t> codes(count);
    REQUIRE(encode_directions(std::span<const float>(vectors.span()), codes.span()) == expected);
    for (const Execution execution : kExecutions) {
        Exact<std::uint8_t> same(count);
        REQUIRE(encode_directions(std::span<const float>(vectors.span()), same.span(), execution) ==
                expected);
        REQUIRE(expected != kAllFinite ||
                std::equal(codes.span().begin(), codes.span().end(), same.span().begin()));
    }
    if (expected != kAllFinite) return;
    constexpr double kLeastCosine = 0.9999954;  // of 0.174°: docs/spec/gradient-code.md has 0.1731°
    const Exact<float> directions = decoded(codes);
    for (std::size_t i = 0; i < count; i += 3) {
        const float *v = &vectors[i], *d = &directions[i];
        const double dot = double{v[0]} * d[0] + double{v[1]} * d[1] + double{v[2]} * d[2];
        REQUIRE(length(v) == 0 ? length(d) == 0 : dot >= kLeastCosine * length(v) * length(d));
        REQUIRE(length(v) == 0 || length(d) > 0);
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    decoded(Exact<std::uint8_t>(std::span(data, size / 3 * 3)));
    encode_any({data, size});
    return 0;
}
