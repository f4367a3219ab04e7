// Single voxels of a code with a width per block, decoded: the access policy of interpolation.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "any_width_decoder.h"
#include "four.h"
#include "interpolation.h"
#include "s3dc_access.h"
#include "s3dc_variable_format.h"
#include "simd.h"

namespace octobrick::codec::detail {

template <class T, class Fetches>
class VariableAccess;

// What an access needs to know. The bytes are a code of this layout, without a prediction.
struct VariableCode {
    VariableLayout layout;
    SampleType type;
    Zyx shape;
    std::span<const std::byte> bytes;

    template <class T, class Fetches>
    using Access = VariableAccess<T, Fetches>;
};

// Tables tell where a block's payload begins. They were checked, but bytes may change meanwhile: so
// places in the payload, and these alone, are held inside of the code at every read.
template <class T, class Fetches>
class VariableAccess {
    using Decoder = AnyWidthDecoder<T>;
    using Ends = typename Decoder::Ends;

    // Payload of a block.
    struct Run {
        std::size_t begin;
        unsigned width;
    };

  public:
    struct One {
        std::size_t block, index;  // the number of the block, and of the voxel in it
        Run run;
    };
    struct Eight {
        std::size_t block, index;      // of the first voxel
        std::size_t to_x, to_y, to_z;  // from its index to that of the next voxel, maybe backwards
        IntFour next_block;  // -1 on each axis where the next voxel is in the next block, else 0
        Run runs[2][4];      // at x, then at x + 1 if that is in another block; order of Corners
    };

    explicit VariableAccess(const VariableCode& code, Fetches fetches = {})
        : bytes_(reinterpret_cast<const std::uint8_t*>(code.bytes.data())),
          last_word_(code.bytes.size() - sizeof(std::uint64_t)),
          type_(code.type),
          step_{code.shape.x > 1, code.shape.y > 1, code.shape.z > 1, 0},
          rows_((code.shape.y > 1 ? 2 : 0) + (code.shape.z > 1 ? 1 : 0)),
          blocks_(code.shape, code.layout.block),
          row_(code.layout.block.x),
          slice_(code.layout.block.x * code.layout.block.y),
          row_blocks_(code.layout.grid.x),
          slice_blocks_(code.layout.grid.x * code.layout.grid.y),
          groups_begin_(code.layout.groups_begin),
          payload_begin_(code.layout.payload_begin),
          unit_nbytes_(code.layout.unit_nbytes),
          fetches_(fetches) {}

    const IntFour& step() const { return step_; }

    OCTOBRICK_INLINE One place_one(int x, int y, int z) const {
        One place;
        const IntFour voxel = {x, y, z, 0};
        IntFour block, within;
        blocks_.block_of(voxel, block);
        blocks_.within(voxel, block, within);
        place.block = number_of(block);
        place.index = index_of(within);
        return place;
    }

    OCTOBRICK_INLINE void place_eight(const IntFour& low, Eight& place) const {
        IntFour block, within;
        blocks_.block_of(low, block);
        blocks_.within(low, block, within);
        place.block = number_of(block);
        place.index = index_of(within);
        blocks_.ends(low, block, place.next_block);
        place.next_block &= -step_;
        // To the first one of the next block; or one further, where there is one.
        const IntFour to = place.next_block != 0 ? -within : step_;
        place.to_x = offset(to[0]);
        place.to_y = offset(to[1]) * row_;
        place.to_z = offset(to[2]) * slice_;
    }

    OCTOBRICK_INLINE void prefetch(const One& place) const { prefetch_tables(place.block); }
    OCTOBRICK_INLINE void prefetch(const Eight& place) const {
        prefetch_tables(place.block);
        if (place.next_block[1] != 0) prefetch_tables(place.block + row_blocks_);
        if (place.next_block[2] != 0) prefetch_tables(place.block + slice_blocks_);
    }

    OCTOBRICK_INLINE void look_up(One& place) const {
        place.run = run_of(place.block);
        prefetch_index(place.run, place.index);
    }
    OCTOBRICK_INLINE void look_up(Eight& place) const {
        const auto run = [this](std::size_t block, int)
                             OCTOBRICK_INLINE_LAMBDA { return run_of(block); };
        each_block(place.block, place.next_block, run, place.runs[0]);
        for (int row = 0; row < 4; ++row) {
            prefetch_index(place.runs[0][row], index_in_row(place, row));
        }
        if (place.next_block[0] != 0) {
            each_block(place.block + 1, place.next_block, run, place.runs[1]);
        }
    }

    OCTOBRICK_INLINE double one(const One& place) const {
        std::uint32_t index, same;
        fetch_index(place.run, place.index, 0, index, same);
        return decoder_.value(fetch_ends(place.block, place.run.width), index);
    }

    OCTOBRICK_INLINE void eight(const Eight& place, Corners& corners) const {
        const IntFour next = place.next_block;
        UintFour low = {}, high = {};
        fetch_rows(place.runs[0], place, 0, next[0] == 0 ? place.to_x : 0, low, high);
        if ((next[0] | next[1] | next[2]) == 0) {
            const Ends ends = fetch_ends(place.block, place.runs[0][0].width);
            decoder_.values(ends, low, corners.low);
            decoder_.values(ends, high, corners.high);
            return;
        }
        Ends ends[4];
        fetch_blocks(place.block, place.runs[0], next, ends);
        decoder_.values(ends, low, corners.low);
        if (next[0] != 0) {
            fetch_rows(place.runs[1], place, place.to_x, 0, high, low);
            fetch_blocks(place.block + 1, place.runs[1], next, ends);
        }
        decoder_.values(ends, high, corners.high);
    }

  private:
    static std::size_t index(int i) { return static_cast<std::uint32_t>(i); }
    static std::size_t offset(int i) {  // of either sign: sums of sizes wrap
        return static_cast<std::size_t>(static_cast<std::ptrdiff_t>(i));
    }
    OCTOBRICK_INLINE std::size_t number_of(const IntFour& block) const {
        return index(block[2]) * slice_blocks_ + index(block[1]) * row_blocks_ + index(block[0]);
    }
    OCTOBRICK_INLINE std::size_t index_of(const IntFour& within) const {
        return index(within[2]) * slice_ + index(within[1]) * row_ + index(within[0]);
    }
    // Of a row of two voxels, in the order of Corners.
    OCTOBRICK_INLINE static std::size_t index_in_row(const Eight& place, int row) {
        return place.index + (row >= 2 ? place.to_y : 0) + (row % 2 != 0 ? place.to_z : 0);
    }

    // What get(number, row) gives for the blocks of four voxels of one x, each asked for once.
    template <class Get, class Found>
    OCTOBRICK_INLINE void each_block(std::size_t block, const IntFour& next, const Get& get,
                                     Found (&found)[4]) const {
        found[0] = get(block, 0);
        found[1] = next[2] != 0 ? get(block + slice_blocks_, 1) : found[0];
        found[2] = next[1] != 0 ? get(block + row_blocks_, 2) : found[0];
        found[3] = next[1] == 0   ? found[1]
                   : next[2] == 0 ? found[2]
                                  : get(block + row_blocks_ + slice_blocks_, 3);
    }

    // ---- Tables ----

    OCTOBRICK_INLINE void prefetch_tables(std::size_t block) const {
        __builtin_prefetch(bytes_ + groups_begin_ + kGroup_nbytes * (block / kGroup));
        __builtin_prefetch(bytes_ + 2 * sizeof(T) * block);
    }

    OCTOBRICK_INLINE Run run_of(std::size_t block) const {
        const std::uint8_t* entry = bytes_ + groups_begin_ + kGroup_nbytes * (block / kGroup);
        const std::uint32_t widths = load32(entry + 4);
        const std::size_t i = block % kGroup;
        const std::size_t units = std::size_t{load32(entry)} + units_before(widths, i, type_);
        return {payload_begin_ + units * unit_nbytes_, widths >> 4 * i & 15};
    }

    OCTOBRICK_INLINE Ends fetch_ends(std::size_t block, unsigned width) const {
        fetches_.end_points();
        T ends[2];
        std::memcpy(ends, bytes_ + sizeof ends * block, sizeof ends);
        return decoder_.ends(ends[0], ends[1], width);
    }

    // The end points of four voxels of one x.
    OCTOBRICK_INLINE void fetch_blocks(std::size_t block, const Run (&runs)[4], const IntFour& next,
                                       Ends (&ends)[4]) const {
        each_block(
            block, next,
            [&](std::size_t number, int row)
                OCTOBRICK_INLINE_LAMBDA { return fetch_ends(number, runs[row].width); },
            ends);
    }

    // ---- Indices ----

    // Bits of the first plane of indices, and of the second, of their higher ones.
    OCTOBRICK_INLINE static unsigned low_bits(unsigned width) {
        return width == kRaw ? 8 * sizeof(T) : width < 8 ? width : 8;
    }
    OCTOBRICK_INLINE static unsigned high_bits(unsigned width) {
        return width == kRaw || width <= 8 ? 0 : width - 8;
    }

    OCTOBRICK_INLINE void prefetch_index(const Run& run, std::size_t i) const {
        const std::size_t at = run.begin + i * low_bits(run.width) / 8;
        __builtin_prefetch(bytes_ + (at < last_word_ ? at : last_word_));
    }

    // Numbers i and i + next of a plane, where next is 0 or 1. The code has at least 12 bytes, and
    // where its end is near, the bits are in its last 64.
    OCTOBRICK_INLINE void fetch_bits(std::size_t plane, unsigned bits, std::size_t i,
                                     std::size_t next, std::uint32_t& first,
                                     std::uint32_t& second) const {
        const std::size_t bit = i * bits;
        fetches_.words((bit % 32 + bits * (1 + next) + 31) / 32);
        const std::size_t at = plane + bit / 8, from = at < last_word_ ? at : last_word_;
        std::uint64_t word;
        std::memcpy(&word, bytes_ + from, sizeof word);
        word >>= (8 * (at - from) + bit % 8) % 64;
        const std::uint64_t mask = (std::uint64_t{1} << bits) - 1;
        first = static_cast<std::uint32_t>(word & mask);
        second = static_cast<std::uint32_t>(word >> bits * next & mask);
    }

    // The indices of voxels i and i + next of a block.
    OCTOBRICK_INLINE void fetch_index(const Run& run, std::size_t i, std::size_t next,
                                      std::uint32_t& first, std::uint32_t& second) const {
        first = second = 0;
        if (run.width == 0) return;
        fetch_bits(run.begin, low_bits(run.width), i, next, first, second);
        if (run.width <= 8) return;
        if (run.width == kRaw) {
            first = Decoder::index_of_raw(first);
            second = Decoder::index_of_raw(second);
            return;
        }
        std::uint32_t first_high, second_high;
        fetch_bits(run.begin + 8 * unit_nbytes_, high_bits(run.width), i, next, first_high,
                   second_high);
        first |= first_high << 8;
        second |= second_high << 8;
    }

    // The same of four rows, from `ahead` behind their first voxels on.
    OCTOBRICK_INLINE void fetch_rows(const Run (&runs)[4], const Eight& place, std::size_t ahead,
                                     std::size_t next, UintFour& first, UintFour& second) const {
        std::uint32_t a[4], b[4];
        for (int row = 0; row < 4; ++row) {  // a loop: inlined four times it takes long to compile
            const int same = row & rows_;
            if (same == row) {
                fetch_index(runs[row], index_in_row(place, row) + ahead, next, a[row], b[row]);
            } else {
                a[row] = a[same];
                b[row] = b[same];
            }
        }
        first = UintFour{a[0], a[1], a[2], a[3]};
        second = UintFour{b[0], b[1], b[2], b[3]};
    }

    const std::uint8_t* bytes_;
    std::size_t last_word_;  // where the last 64 bits begin
    SampleType type_;
    IntFour step_;
    int rows_;  // the last of the rows of Corners that is none of those before it
    BlockAxes blocks_;
    std::size_t row_, slice_;  // from a voxel of a block to the next one in y and z
    std::size_t row_blocks_, slice_blocks_;
    std::size_t groups_begin_, payload_begin_, unit_nbytes_;
    Decoder decoder_;
    Fetches fetches_;
};

}  // namespace octobrick::codec::detail
