// From the bytes of a unit block that has been checked to colours: views of its parts, and the
// inverse transform in voxel, plane and cell mode.
#pragma once

#include <algorithm>
#include <bit>

#include "haar.h"
#include "zerobit_format.h"

namespace octobrick::codec::detail {

constexpr std::uint64_t kDetailBits = 0x7f7f7f7f7f7f7f7fu;  // of eight maps: all but the level

// Bits [0, n) of 64, n <= 64.
constexpr std::uint64_t low_bits(unsigned n) {
    return n >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << n) - 1;
}

// Of a unit block that has been checked: the flags of its cells. A void one has none; what is
// loaded instead are bytes of the code nevertheless, for 8 zeros end it.
inline std::uint64_t flags_of(const std::uint8_t* block) {
    const auto flags = load<std::uint64_t>(block + 1);
    return block[0] == 0 ? 0 : flags;
}

// Where the information of a cell is that is not null, by the flags of its block.
inline const std::uint8_t* info_of(const std::uint8_t* block, std::uint64_t flags, unsigned cell) {
    const std::uint64_t earlier = flags & ((std::uint64_t{1} << cell) - 1);
    return block + 9 + kCellInfoNbytes * static_cast<unsigned>(std::popcount(earlier));
}

// The same, null where the cell is.
inline const std::uint8_t* find_cell(const std::uint8_t* block, unsigned cell) {
    const std::uint64_t flags = flags_of(block);
    return (flags >> cell & 1) != 0 ? info_of(block, flags, cell) : nullptr;
}

// ZSMS, and DIS behind it, of a unit block that is not void.
inline const std::uint8_t* streams_of(const std::uint8_t* block) {
    return block + 9 + kCellInfoNbytes * block[0];
}

// The paper's cell information, decoded.
struct CellView {
    CellView() = default;
    CellView(const std::uint8_t* info, const std::uint8_t* streams) {
        const auto zerobit = load<std::uint16_t>(info + 3);
        average = info[0];
        details = streams + load<std::uint16_t>(info + 1);
        zerobits = streams + (zerobit & 0x7fffu);
        level0 = zerobit >> 15;
    }

    bool has(unsigned node) const { return (*zerobits >> node & 1) != 0; }
    const std::uint8_t* maps() const { return zerobits + 1; }

    // Maps before that of level-1 node `node` (0 to 7).
    unsigned maps_before(unsigned node) const {
        return level0 + static_cast<unsigned>(std::popcount(*zerobits & low_bits(node)));
    }

    // Details in the first `count` maps, count <= 8. Loads 8 bytes: the code ends with as many.
    unsigned details_in(unsigned count) const {
        return static_cast<unsigned>(
            std::popcount(load<std::uint64_t>(maps()) & kDetailBits & low_bits(8 * count)));
    }

    const std::uint8_t* zerobits = nullptr;  // the byte of level 1
    const std::uint8_t* details = nullptr;
    unsigned level0 = 0;  // its zerobit
    std::uint8_t average = 0;
};

// Calls f(j, index) for every detail of a map, j being 1 to 7.
template <class F>
void for_each_detail(unsigned map, const std::uint8_t* details, const F& f) {
    for (map &= 0x7f; map != 0; map &= map - 1) {
        f(static_cast<unsigned>(std::countr_zero(map)) + 1, *details++);
    }
}

// Codewords by their indices.
template <class V>
struct Codewords {
    const V& operator[](std::uint8_t index) const { return of[index]; }
    V of[kCodewords] = {};
};

// How each detail of a map counts for value `at` (4z + 2y + x) of its node, in 16 bits per detail,
// in the order of their indices: 0 where it is added, kCodewords where it is subtracted, twice
// that where there is no such detail.
struct Signs {
    constexpr Signs() {
        for (unsigned at = 0; at < 8; ++at) {
            const unsigned letters = at / 4 + (at & 2) + at % 2 * 4;  // as those of j lie
            for (unsigned map = 0; map < 128; ++map) {
                std::uint64_t* const of[2] = {&first[at][map], &rest[at][map]};
                unsigned k = 0;
                for (unsigned j = 1; j < 8; ++j) {
                    if ((map >> (j - 1) & 1) == 0) continue;
                    const std::uint64_t minus = std::popcount(letters & j) & 1;
                    *of[k / 4] |= minus * kCodewords << 16 * (k % 4);
                    ++k;
                }
                for (; k < 8; ++k) *of[k / 4] |= std::uint64_t{2 * kCodewords} << 16 * (k % 4);
            }
        }
    }
    std::uint64_t first[8][128] = {}, rest[8][128] = {};  // details 0 to 3, and 4 to 6
};
inline constexpr Signs kSigns;

// Four bytes, to 16 bits each.
constexpr std::uint64_t widened(std::uint32_t bytes) {
    const std::uint64_t halves = (bytes | std::uint64_t{bytes} << 16) & 0x0000ffff0000ffffu;
    return (halves | halves << 8) & 0x00ff00ff00ff00ffu;
}

// What a detail adds to a value, by its index plus what Signs says: in whole numbers the order of
// additions does not matter, so that a voxel takes its details one by one. Of the others nothing.
template <class V, bool Whole = std::is_integral_v<typename V::Scalar>>
struct Terms {
    // The share of all details of a map, added to `value`. How many there are is hard to foresee,
    // so four are taken always, and the others, of which there are few, if need be.
    V add_to(V value, unsigned map, const std::uint8_t* details, unsigned at) const {
        std::uint64_t which = widened(load<std::uint32_t>(details)) | kSigns.first[at][map];
        for (unsigned k = 0; k < 4; ++k) value = value + of[which >> 16 * k & 0xffff];
        if (std::popcount(map) > 4) {
            which = widened(load<std::uint32_t>(details + 4)) | kSigns.rest[at][map];
            for (unsigned k = 0; k < 3; ++k) value = value + of[which >> 16 * k & 0xffff];
        }
        return value;
    }

    void set(unsigned index, const V& codeword) {
        of[index] = codeword;
        of[kCodewords + index] = V{} - codeword;
    }

    V of[3 * kCodewords] = {};
};
template <class V>
struct Terms<V, false> {
    void set(unsigned, const V&) {}
};

// The decoder's arithmetic: codewords in, colours out. V is Lanes, or counts.
template <class V>
struct Synthesis {
    Codewords<V> average, detail;
    Terms<V> terms;

    // One value of a node, `at` being 4z + 2y + x.
    V value(const V& from, unsigned map, const std::uint8_t* details, unsigned at) const {
        if constexpr (std::is_integral_v<typename V::Scalar>) {
            return terms.add_to(from, map & 0x7f, details, at);
        } else {
            V values[8];
            apply(from, map, details, Part::one(at / 4), Part::one(at / 2 % 2), Part::one(at % 2),
                  values);
            return values[at];
        }
    }

    void apply(const V& from, unsigned map, const std::uint8_t* details, Part z, Part y, Part x,
               V (&values)[8]) const {
        V node[8] = {from};
        for_each_detail(map, details,
                        [&](unsigned j, std::uint8_t index) { node[j] = detail[index]; });
        haar_inverse(node, z, y, x, values);
    }

    // The average of level-1 node `node`, 4z + 2y + x.
    V node_average(const CellView& cell, unsigned node) const {
        return value(average[cell.average], cell.maps()[0] & (0u - cell.level0), cell.details,
                     node);
    }

    // Voxel `half` (4z + 2y + x) of a level-1 node that is not null, from its average.
    V node_voxel(const V& from, const CellView& cell, unsigned node, unsigned half) const {
        const unsigned before = cell.maps_before(node);
        return value(from, cell.maps()[before], cell.details + cell.details_in(before), half);
    }

    // Voxel mode: one voxel (z, y, x) of a cell.
    V voxel(const CellView& cell, unsigned z, unsigned y, unsigned x) const {
        const unsigned node = 4 * (z / 2) + 2 * (y / 2) + x / 2;
        const V parent = node_average(cell, node);
        return cell.has(node) ? node_voxel(parent, cell, node, 4 * (z % 2) + 2 * (y % 2) + x % 2)
                              : parent;
    }

    // The averages of the wanted nodes, one per 2^3 voxels.
    void averages(const CellView& cell, Part z, Part y, Part x, V (&values)[8]) const {
        if (cell.level0 != 0) {
            apply(average[cell.average], cell.maps()[0], cell.details, z, y, x, values);
        } else {
            std::fill(values, values + 8, average[cell.average]);
        }
    }

    // Calls f(z, y, x, sample(value)) for every voxel of the nodes and, in them, of the halves
    // wanted. A null node, of one value, has one sample.
    template <class S, class F>
    void each_voxel(const CellView& cell, const Part (&nodes)[3], const Part (&halves)[3],
                    const S& sample, const F& f) const {
        V parents[8];
        averages(cell, nodes[0], nodes[1], nodes[2], parents);
        for (unsigned z = nodes[0].begin; z < nodes[0].end; ++z) {
            for (unsigned y = nodes[1].begin; y < nodes[1].end; ++y) {
                for (unsigned x = nodes[2].begin; x < nodes[2].end; ++x) {
                    const unsigned node = 4 * z + 2 * y + x;
                    if (cell.has(node)) {
                        V values[8];
                        const unsigned before = cell.maps_before(node);
                        apply(parents[node], cell.maps()[before],
                              cell.details + cell.details_in(before), halves[0], halves[1],
                              halves[2], values);
                        each_half(halves, [&](unsigned iz, unsigned iy, unsigned ix) {
                            f(2 * z + iz, 2 * y + iy, 2 * x + ix,
                              sample(values[4 * iz + 2 * iy + ix]));
                        });
                    } else {
                        const auto same = sample(parents[node]);
                        each_half(halves, [&](unsigned iz, unsigned iy, unsigned ix) {
                            f(2 * z + iz, 2 * y + iy, 2 * x + ix, same);
                        });
                    }
                }
            }
        }
    }

    template <class F>
    static void each_half(const Part (&halves)[3], const F& f) {
        for (unsigned z = halves[0].begin; z < halves[0].end; ++z) {
            for (unsigned y = halves[1].begin; y < halves[1].end; ++y) {
                for (unsigned x = halves[2].begin; x < halves[2].end; ++x) f(z, y, x);
            }
        }
    }
};

}  // namespace octobrick::codec::detail
