// The parts of a variable-rate code: docs/spec/s3dc-variable.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "octobrick/codec/s3dc_variable.h"
#include "rows.h"

namespace octobrick::codec::detail {

inline constexpr std::size_t kGroup = 8;            // blocks that share an entry of the table
inline constexpr std::size_t kGroup_nbytes = 8;     // first unit (u32), then eight widths of 4 bits
inline constexpr std::size_t kIndicesPerUnit = 32;  // so many of one bit fill a 32-bit word
inline constexpr unsigned kRaw = 15;                // the width of a block whose voxels are uncoded
inline constexpr unsigned kMostWidth = 14;          // of an index

// The widest index of a sample type, whose next step is an exact copy: 8-bit samples are exact
// with 8 bits, and are never raw.
constexpr unsigned most_width(SampleType type) { return sample_nbytes(type) == 1 ? 8 : kMostWidth; }

// Units that a block of this width takes.
constexpr std::uint64_t units_of(unsigned width, SampleType type) {
    return width == kRaw ? 8 * sample_nbytes(type) : width;
}

// Units of the first n < 8 blocks of a group with these widths, four bits each: the sum of the
// widths, by pairs, and for each raw block what it takes more than its 15.
constexpr std::uint32_t units_before(std::uint32_t widths, std::size_t n, SampleType type) {
    widths &= (1u << 4 * n) - 1;
    const std::uint32_t pairs = (widths & 0x0f0f0f0f) + (widths >> 4 & 0x0f0f0f0f);
    const std::uint32_t sum = pairs * 0x01010101 >> 24;  // at most 7·15
    const std::uint32_t raw = widths & widths >> 1 & widths >> 2 & widths >> 3 & 0x11111111;
    const auto more = static_cast<std::uint32_t>(units_of(kRaw, type)) - kRaw;  // wraps for 8 bits
    return sum + (raw * 0x11111111 >> 28) * more;
}

inline std::uint32_t load32(const std::uint8_t* from) {
    std::uint32_t word;
    std::memcpy(&word, from, sizeof word);
    return word;
}
inline void store32(std::uint8_t* to, std::uint32_t word) { std::memcpy(to, &word, sizeof word); }

// The tables of a code, whose sizes were checked.
class Tables {
  public:
    Tables(const VariableLayout& layout, const std::uint8_t* code, SampleType type)
        : layout_(layout), code_(code), type_(type) {}

    std::uint32_t group_first(std::size_t group) const { return load32(entry(group)); }
    std::uint32_t group_widths(std::size_t group) const { return load32(entry(group) + 4); }
    unsigned width(std::size_t block) const {
        return group_widths(block / kGroup) >> 4 * (block % kGroup) & 15;
    }
    bool predicted(std::size_t block) const {
        return layout_.flags_begin != layout_.payload_begin &&
               (code_[layout_.flags_begin + block / kGroup] >> block % kGroup & 1) != 0;
    }
    // Units before a block: those before its group, and those of the blocks of the group before it.
    std::uint64_t units(std::size_t block) const {
        const std::size_t group = block / kGroup;
        return std::uint64_t{group_first(group)} +
               units_before(group_widths(group), block % kGroup, type_);
    }
    // Where the block's indices or voxels begin.
    const std::uint8_t* payload(std::size_t block) const {
        return code_ + layout_.payload_begin + units(block) * layout_.unit_nbytes;
    }
    const std::uint8_t* end_points(std::size_t block) const {
        return code_ + 2 * sample_nbytes(type_) * block;
    }

  private:
    const std::uint8_t* entry(std::size_t group) const {
        return code_ + layout_.groups_begin + kGroup_nbytes * group;
    }

    const VariableLayout& layout_;
    const std::uint8_t* code_;
    SampleType type_;
};

// Checks everything before the payload but the end points, and the size of the whole.
Outcome check_tables(const VariableLayout& layout, std::span<const std::byte> code,
                     SampleType type) noexcept;

// The place of a block in the grid.
inline Zyx place_of(std::size_t block, Zyx grid) {
    return {block / grid.x / grid.y, block / grid.x % grid.y, block % grid.x};
}

// The voxels that block `at` has.
inline Zyx extent_of(Zyx at, Zyx block, Zyx shape) {
    return {std::min(block.z, shape.z - at.z * block.z),
            std::min(block.y, shape.y - at.y * block.y),
            std::min(block.x, shape.x - at.x * block.x)};
}

// Whether a prediction is of this type and shape; and where it first is not finite.
Outcome check_prediction(const ConstVolume* prediction, SampleType type, Zyx shape);

}  // namespace octobrick::codec::detail
