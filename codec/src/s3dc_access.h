// Single voxels of an S3Dc code, decoded: the access policy of interpolation.h.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "four.h"
#include "interpolation.h"
#include "octobrick/codec/s3dc_sampler.h"
#include "simd.h"
#include "voxel_decoder.h"

namespace octobrick::codec::detail {

// ---- Counting ----

// Two ways of looking at fetches: not at all, without a trace in the compiled code, and counting.
struct IgnoreFetches {
    void end_points() const {}
    void words(std::size_t) const {}
};
struct CountFetches {
    void end_points() const { ++sum->end_points; }
    void words(std::size_t n) const { sum->words += n; }
    S3dcFetches* sum;
};

// ---- Where things lie ----

// Which block a voxel is in: floor((x + 1/2)·(1/b)). The exact quotient is at least 1/(2b) away
// from any integer; rounded twice it is off by less than that while x < 2^50.
class BlockAxes {
  public:
    BlockAxes(Zyx shape, Zyx block) {
        const std::size_t n[4] = {shape.x, shape.y, shape.z, 1};
        const std::size_t b[4] = {block.x, block.y, block.z, 1};
        for (int axis = 0; axis < 4; ++axis) {
            const std::size_t size = std::min(b[axis], n[axis]);
            size_[axis] = static_cast<std::int32_t>(size);
            inverse_[axis] = 1.0 / static_cast<double>(size);
        }
    }

    OCTOBRICK_INLINE void block_of(const IntFour& voxel, IntFour& block) const {
        DoubleFour centre;
        convert(voxel, centre);
        convert((centre + 0.5) * inverse_, block);
    }

    // The same for one axis.
    OCTOBRICK_INLINE int block_of(int axis, int voxel) const {
        return static_cast<int>((static_cast<double>(voxel) + 0.5) * inverse_[axis]);
    }

    // Where a voxel is in its block.
    OCTOBRICK_INLINE void within(const IntFour& voxel, const IntFour& block, IntFour& place) const {
        place = voxel - block * size_;
    }

    // Where the next voxel is in the next block: -1, else 0. The last block counts as a whole one.
    // No sum overflows: where the last block is cut, its end is not reached.
    OCTOBRICK_INLINE void ends(const IntFour& voxel, const IntFour& block, IntFour& at_end) const {
        at_end = voxel - block * size_ == size_ - 1;
    }

  private:
    IntFour size_;
    DoubleFour inverse_;
};

template <class T, class Fetches>
class S3dcAccess;

// What an access needs to know. The bytes are a code of this layout.
struct FixedCode {
    S3dc codec;
    Layout layout;
    Zyx shape;
    const std::byte* bytes;

    template <class T, class Fetches>
    using Access = S3dcAccess<T, Fetches>;
};

template <class T, class Fetches>
class S3dcAccess {
    using Decoder = VoxelDecoder<T>;
    using Ends = typename Decoder::Ends;
    static constexpr std::size_t kPair = 2 * sizeof(T);

  public:
    // Offsets are in bytes from the start of the code. `row` is where to read 32 bits, which hold
    // the wanted indices from bit `shift` on; `pair` is where the first voxel's end points are.
    struct One {
        std::size_t row, pair;
        unsigned shift;
    };
    struct Eight : One {
        IntFour next_block;  // -1 on each axis where the next voxel is in the next block, else 0
    };

    // What the code holds is not looked at, and never a place to read from.
    explicit S3dcAccess(const FixedCode& code, Fetches fetches = {})
        : code_(code.bytes),
          bits_(code.codec.bits),
          next_(code.shape.x > 1 ? bits_ : 0),
          mask_((1u << bits_) - 1),
          step_{code.shape.x > 1, code.shape.y > 1, code.shape.z > 1, 0},
          blocks_(code.shape, code.codec.block),
          pair_row_nbytes_(code.layout.grid.x * kPair),
          pair_slice_nbytes_(code.layout.grid.y * pair_row_nbytes_),
          rows_at_(code.layout.end_points_nbytes),
          row_nbytes_(code.layout.row_nbytes),
          slice_nbytes_(code.shape.y * row_nbytes_),
          next_row_(code.shape.y > 1 ? row_nbytes_ : 0),
          next_slice_(code.shape.z > 1 ? slice_nbytes_ : 0),
          decoder_(bits_),
          fetches_(fetches) {}

    const IntFour& step() const { return step_; }

    OCTOBRICK_INLINE One place_one(int x, int y, int z) const {
        One place;
        place_row(x, y, z, bits_, place);
        place.pair =
            pair_of(blocks_.block_of(0, x), blocks_.block_of(1, y), blocks_.block_of(2, z));
        return place;
    }

    OCTOBRICK_INLINE void place_eight(const IntFour& low, Eight& place) const {
        IntFour block;
        blocks_.block_of(low, block);
        place_row(low[0], low[1], low[2], bits_ + next_, place);
        place.pair = pair_of(block[0], block[1], block[2]);
        blocks_.ends(low, block, place.next_block);
        place.next_block &= -step_;
    }

    OCTOBRICK_INLINE void prefetch(const One& place) const {
        __builtin_prefetch(code_ + place.row);
        __builtin_prefetch(code_ + place.pair);
    }
    OCTOBRICK_INLINE void prefetch(const Eight& place) const {
        for (const std::size_t slice : {std::size_t{0}, next_slice_}) {
            __builtin_prefetch(code_ + place.row + slice);
            __builtin_prefetch(code_ + place.row + slice + next_row_);
        }
        __builtin_prefetch(code_ + place.pair);
    }

    OCTOBRICK_INLINE void look_up(One&) const {}
    OCTOBRICK_INLINE void look_up(Eight&) const {}

    OCTOBRICK_INLINE double one(const One& place) const {
        const Ends ends = fetch_ends(place.pair);
        return decoder_.value(ends, fetch_row(place, place.row) >> place.shift & mask_);
    }

    OCTOBRICK_INLINE void eight(const Eight& place, Corners& corners) const {
        UintFour rows = {};
        fetch_rows(place, rows);
        const UintFour low = rows & mask_, high = rows >> next_ & mask_;
        const Ends first = fetch_ends(place.pair);
        const IntFour next = place.next_block;
        if ((next[0] | next[1] | next[2]) == 0) {
            decoder_.values(first, low, corners.low);
            decoder_.values(first, high, corners.high);
            return;
        }
        Ends at_x[4], at_next_x[4];
        fetch_blocks(place.pair, next[1], next[2], first, at_x);
        decoder_.values(at_x, low, corners.low);
        if (next[0] == 0) {
            decoder_.values(at_x, high, corners.high);
            return;
        }
        const std::size_t pair = place.pair + kPair;
        fetch_blocks(pair, next[1], next[2], fetch_ends(pair), at_next_x);
        decoder_.values(at_next_x, high, corners.high);
    }

  private:
    // Where `width` bits from a voxel's index on are: in one 16-bit word, or in two. Two words are
    // read anyway; where one would do, it is the second, so that nothing is read from behind the
    // code. Before the first row there are end points.
    OCTOBRICK_INLINE void place_row(int x, int y, int z, unsigned width, One& place) const {
        const std::size_t bit = index(x) * bits_;
        const auto shift = static_cast<unsigned>(bit % 16);
        const unsigned one = shift + width > 16 ? 0 : 1;
        place.row = rows_at_ + index(z) * slice_nbytes_ + index(y) * row_nbytes_ + bit / 16 * 2 -
                    2 * std::size_t{one};
        place.shift = shift + 16 * one;
    }

    OCTOBRICK_INLINE std::size_t pair_of(int x, int y, int z) const {
        return index(z) * pair_slice_nbytes_ + index(y) * pair_row_nbytes_ + index(x) * kPair;
    }

    static std::size_t index(int i) { return static_cast<std::uint32_t>(i); }

    OCTOBRICK_INLINE std::uint32_t fetch_row(const One& place, std::size_t row) const {
        fetches_.words(place.shift < 16 ? 2 : 1);
        std::uint32_t words;
        std::memcpy(&words, code_ + row, sizeof words);
        return words;
    }

    // The rows of eight voxels, in the order of Corners.
    OCTOBRICK_INLINE void fetch_rows(const Eight& place, UintFour& rows) const {
        const std::size_t at = place.row;
        rows[0] = fetch_row(place, at);
        rows[1] = next_slice_ != 0 ? fetch_row(place, at + next_slice_) : rows[0];
        rows[2] = next_row_ != 0 ? fetch_row(place, at + next_row_) : rows[0];
        rows[3] = next_slice_ == 0 ? rows[2]
                  : next_row_ == 0 ? rows[1]
                                   : fetch_row(place, at + next_row_ + next_slice_);
        rows >>= place.shift;
    }

    OCTOBRICK_INLINE Ends fetch_ends(std::size_t pair) const {
        fetches_.end_points();
        T ends[2];
        std::memcpy(ends, code_ + pair, sizeof ends);
        return decoder_.ends(ends[0], ends[1]);
    }

    // The end points of four voxels of one x, in the order of Corners; those of the first are
    // known.
    OCTOBRICK_INLINE void fetch_blocks(std::size_t pair, int next_y, int next_z, const Ends& first,
                                       Ends (&ends)[4]) const {
        ends[0] = first;
        ends[1] = next_z != 0 ? fetch_ends(pair + pair_slice_nbytes_) : first;
        ends[2] = next_y != 0 ? fetch_ends(pair + pair_row_nbytes_) : first;
        ends[3] = next_y == 0   ? ends[1]
                  : next_z == 0 ? ends[2]
                                : fetch_ends(pair + pair_row_nbytes_ + pair_slice_nbytes_);
    }

    const std::byte* code_;
    unsigned bits_, next_;  // of an index; from an index to that of the next voxel in x
    std::uint32_t mask_;
    IntFour step_;
    BlockAxes blocks_;
    std::size_t pair_row_nbytes_, pair_slice_nbytes_;
    std::size_t rows_at_, row_nbytes_, slice_nbytes_;
    std::size_t next_row_, next_slice_;  // bytes to the next voxel's row in y and z
    Decoder decoder_;
    Fetches fetches_;
};

}  // namespace octobrick::codec::detail
