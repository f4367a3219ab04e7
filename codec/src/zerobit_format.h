// The bytes of docs/spec/zerobit.md that frame the unit blocks: header and codebook.
#pragma once

#include <cmath>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

#include "octobrick/codec/zerobit.h"
#include "rows.h"

namespace octobrick::codec::detail {

inline constexpr std::size_t kHeaderNbytes = 64, kCodebookHeaderNbytes = 16;
inline constexpr std::size_t kTailNbytes = 8;  // zeros, so that 8 bytes can be loaded anywhere
inline constexpr std::size_t kBlock = 16, kCell = 4, kCells = 64;  // voxels, voxels, per block
inline constexpr std::size_t kCellInfoNbytes = 5;
inline constexpr std::size_t kCodewords = 256;

template <class T>
T load(const void* from) {
    T value;
    std::memcpy(&value, from, sizeof value);
    return value;
}

template <class T>
void store(void* to, T value) {
    std::memcpy(to, &value, sizeof value);
}

constexpr std::size_t ceil_div(std::size_t a, std::size_t b) { return (a + b - 1) / b; }
constexpr Zyx ceil_div(Zyx a, std::size_t b) {
    return {ceil_div(a.z, b), ceil_div(a.y, b), ceil_div(a.x, b)};
}

// The type of detail codewords for samples of type T.
template <class T>
using DetailOf = typename std::conditional_t<std::is_floating_point_v<T>, std::common_type<T>,
                                             std::make_signed<T>>::type;

bool supported(SampleType type, unsigned channels) noexcept;

// A codebook, its codewords as numbers.
struct Codebook {
    SampleType type = SampleType::u8;
    unsigned channels = 1;
    std::vector<ZerobitColour> averages, details;
};

std::vector<std::byte> write_codebook(const Codebook& codebook);
// False where the bytes are not a codebook.
bool read_codebook(std::span<const std::byte> bytes, Codebook& codebook);
// The codewords alone, as they lie in either.
void append_codewords(const Codebook& codebook, std::vector<std::byte>& bytes);
bool read_codewords(std::span<const std::byte> bytes, std::size_t averages, std::size_t details,
                    Codebook& codebook);
std::uint64_t digest(std::span<const std::byte> bytes);

// One sample, and the greatest and least of a type.
double read_sample(SampleType type, const void* from);
void write_sample(SampleType type, double value, void* to);

void write_header(const ZerobitHeader& header, std::byte* to);
// Checks every field, and `nbytes` against them; sets where the parts lie.
ZerobitOutcome read_header(std::span<const std::byte> code, ZerobitHeader& header);
// Sets grid, counts and offsets from shape and sizes; false where they overflow.
bool lay_out(ZerobitHeader& header);

}  // namespace octobrick::codec::detail
