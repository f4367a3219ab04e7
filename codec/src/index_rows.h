// Rows of indices, packed: index x at bits [x*bits, (x+1)*bits) of the row, least significant
// first, the row padded with zero bits to whole 16-bit words.
//
// Rows are worked in chunks of 64 indices, 8B bytes whatever B is, held in arrays of fixed size so
// that the compiler sees the trip counts. Neighbours are merged pairwise, and split on the way
// back; for B = 4:
//
//   one index per byte   | 0 0 0 0 b b b b | 0 0 0 0 a a a a |
//   merged               | b b b b a a a a |
//
// Where a merge makes whole bytes of bytes, vectors of them are merged at once. Other widths merge
// three times inside 64-bit words of eight indices, of which the low B bytes are then stored.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "simd.h"

namespace octobrick::codec::detail {

static_assert(std::endian::native == std::endian::little,
              "words are stored as they lie in memory, which the format says is little endian");

inline constexpr std::size_t kChunk = 64;

// The low `width` bits of each `lane` bits of a word.
constexpr std::uint64_t lanes(unsigned width, unsigned lane) {
    const std::uint64_t low = width == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << width) - 1;
    std::uint64_t mask = 0;
    for (unsigned at = 0; at < 64; at += lane) {
        mask |= low << at;
    }
    return mask;
}

// In each two neighbouring lanes of `Lane` bits, moves the low `Width` bits together, and back.
// Each of the two is masked by itself, as their bits would overlap where Width > Lane / 2.
template <unsigned Width, unsigned Lane>
OCTOBRICK_INLINE std::uint64_t merge(std::uint64_t w) {
    constexpr std::uint64_t kLow = lanes(Width, 2 * Lane);
    return (w & kLow) | (w >> (Lane - Width) & kLow << Width);
}
template <unsigned Width, unsigned Lane>
OCTOBRICK_INLINE std::uint64_t split(std::uint64_t w) {
    constexpr std::uint64_t kLow = lanes(Width, 2 * Lane);
    return (w & kLow) | (w << (Lane - Width) & kLow << Lane);
}

// 2N numbers of B bits in bytes, to N numbers of 2B bits in bytes; and back.
template <unsigned B, std::size_t N>
OCTOBRICK_INLINE void merge_bytes(const std::uint8_t* from, std::uint8_t* to) {
    // Unrolled before it is vectorised, gcc 12 would leave it scalar: half the speed.
#pragma GCC unroll 1
    for (std::size_t i = 0; i < N; ++i) {
        std::uint16_t pair;
        std::memcpy(&pair, from + 2 * i, 2);
        to[i] = static_cast<std::uint8_t>(pair | pair >> (8 - B));
    }
}
template <unsigned B, std::size_t N>
OCTOBRICK_INLINE void split_bytes(const std::uint8_t* from, std::uint8_t* to) {
    constexpr auto kLow = static_cast<std::uint16_t>(lanes(B, 8));
    for (std::size_t i = 0; i < N; ++i) {
        const auto pair = static_cast<std::uint16_t>((from[i] | from[i] << (8 - B)) & kLow);
        std::memcpy(to + 2 * i, &pair, 2);
    }
}

// 64 indices to 8B bytes.
template <unsigned B>
OCTOBRICK_INLINE void pack_chunk(const std::uint8_t* indices, std::uint8_t* packed) {
    if constexpr (B == 8) {
        std::memcpy(packed, indices, kChunk);
    } else if constexpr (B == 4) {
        merge_bytes<4, 32>(indices, packed);
    } else if constexpr (B == 2) {
        std::uint8_t nibbles[32];
        merge_bytes<2, 32>(indices, nibbles);
        merge_bytes<4, 16>(nibbles, packed);
    } else if constexpr (B == 1) {
        std::uint8_t pairs[32], nibbles[16];
        merge_bytes<1, 32>(indices, pairs);
        merge_bytes<2, 16>(pairs, nibbles);
        merge_bytes<4, 8>(nibbles, packed);
    } else {
        for (std::size_t i = 0; i < 8; ++i) {
            std::uint64_t w;
            std::memcpy(&w, indices + 8 * i, 8);
            w = merge<4 * B, 32>(merge<2 * B, 16>(merge<B, 8>(w)));
            std::memcpy(packed + i * B, &w, B);
        }
    }
}

// 8B bytes to 64 indices, in `room` or, where nothing needs unpacking, where they are.
template <unsigned B>
OCTOBRICK_INLINE const std::uint8_t* unpack_chunk(const std::uint8_t* packed, std::uint8_t* room) {
    if constexpr (B == 8) {
        return packed;
    } else if constexpr (B == 4) {
        split_bytes<4, 32>(packed, room);
    } else if constexpr (B == 2) {
        std::uint8_t nibbles[32];
        split_bytes<4, 16>(packed, nibbles);
        split_bytes<2, 32>(nibbles, room);
    } else {
        for (std::size_t i = 0; i < 8; ++i) {
            // Whole words are read, the last ones from further ahead so as not to pass the end.
            const std::size_t ahead = i * B > 8 * B - 8 ? i * B - (8 * B - 8) : 0;
            std::uint64_t w;
            std::memcpy(&w, packed + i * B - ahead, 8);
            w = split<B, 8>(split<2 * B, 16>(split<4 * B, 32>(w >> 8 * ahead)));
            std::memcpy(room + 8 * i, &w, 8);
        }
    }
    return room;
}

// The last `nbytes` <= 8B bytes of a row. Indices behind the row's last one must be zero, so the
// padding bits are.
template <unsigned B>
OCTOBRICK_INLINE void pack_tail(const std::uint8_t* indices, std::uint8_t* packed,
                                std::size_t nbytes) {
    std::uint8_t chunk[8 * B];
    pack_chunk<B>(indices, chunk);
    std::memcpy(packed, chunk, nbytes);
}

// Padding bits arrive as indices behind the row's last one.
template <unsigned B>
OCTOBRICK_INLINE void unpack_tail(const std::uint8_t* packed, std::uint8_t* indices,
                                  std::size_t nbytes) {
    std::uint8_t chunk[8 * B] = {};
    std::memcpy(chunk, packed, nbytes);
    std::uint8_t room[kChunk];
    std::memcpy(indices, unpack_chunk<B>(chunk, room), kChunk);
}

}  // namespace octobrick::codec::detail
