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

inline bool has_cell(const std::uint8_t* block, unsigned cell) {
    return (flags_of(block) >> cell & 1) != 0;
}

// Where the information of a cell is that is not null.
inline const std::uint8_t* info_of(const std::uint8_t* block, unsigned cell) {
    const auto before = static_cast<unsigned>(std::popcount(flags_of(block) & low_bits(cell)));
    return block + 9 + kCellInfoNbytes * before;
}

// The same, null where the cell is.
inline const std::uint8_t* find_cell(const std::uint8_t* block, unsigned cell) {
    return has_cell(block, cell) ? info_of(block, cell) : nullptr;
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

// The decoder's arithmetic: codewords in, colours out. V is Lanes, or counts.
template <class V>
struct Synthesis {
    Codewords<V> average, detail;

    // Adds one voxel's share of every detail: in integers the order does not matter.
    V apply(const V& from, unsigned map, const std::uint8_t* details, unsigned z, unsigned y,
            unsigned x) const {
        if constexpr (std::is_integral_v<typename V::Scalar>) {
            const unsigned at = 4 * x + 2 * y + z;  // as the letters of j lie
            V value = from;
            for_each_detail(map, details, [&](unsigned j, std::uint8_t index) {
                value = value.plus(detail[index], (std::popcount(at & j) & 1) != 0);
            });
            return value;
        } else {
            V values[8];
            apply(from, map, details, Part::one(z), Part::one(y), Part::one(x), values);
            return values[4 * z + 2 * y + x];
        }
    }

    void apply(const V& from, unsigned map, const std::uint8_t* details, Part z, Part y, Part x,
               V (&values)[8]) const {
        V node[8] = {from};
        for_each_detail(map, details,
                        [&](unsigned j, std::uint8_t index) { node[j] = detail[index]; });
        haar_inverse(node, z, y, x, values);
    }

    // Voxel mode: one voxel (z, y, x) of a cell.
    V voxel(const CellView& cell, unsigned z, unsigned y, unsigned x) const {
        V value = average[cell.average];
        if (cell.level0 != 0) {
            value = apply(value, cell.maps()[0], cell.details, z / 2, y / 2, x / 2);
        }
        const unsigned node = 4 * (z / 2) + 2 * (y / 2) + x / 2;
        if (!cell.has(node)) return value;
        const unsigned before = cell.maps_before(node);
        return apply(value, cell.maps()[before], cell.details + cell.details_in(before), z % 2,
                     y % 2, x % 2);
    }

    // The averages of the wanted nodes, one per 2^3 voxels.
    void averages(const CellView& cell, Part z, Part y, Part x, V (&values)[8]) const {
        if (cell.level0 != 0) {
            apply(average[cell.average], cell.maps()[0], cell.details, z, y, x, values);
        } else {
            std::fill(values, values + 8, average[cell.average]);
        }
    }

    // Calls f(z, y, x, value) for every voxel of the nodes and, in them, of the halves wanted.
    template <class F>
    void each_voxel(const CellView& cell, const Part (&nodes)[3], const Part (&halves)[3],
                    const F& f) const {
        V parents[8], values[8];
        averages(cell, nodes[0], nodes[1], nodes[2], parents);
        const auto [hz, hy, hx] = halves;
        for (unsigned z = nodes[0].begin; z < nodes[0].end; ++z) {
            for (unsigned y = nodes[1].begin; y < nodes[1].end; ++y) {
                for (unsigned x = nodes[2].begin; x < nodes[2].end; ++x) {
                    const unsigned node = 4 * z + 2 * y + x;
                    if (cell.has(node)) {
                        const unsigned before = cell.maps_before(node);
                        apply(parents[node], cell.maps()[before],
                              cell.details + cell.details_in(before), hz, hy, hx, values);
                    } else {
                        std::fill(values, values + 8, parents[node]);
                    }
                    for (unsigned iz = hz.begin; iz < hz.end; ++iz) {
                        for (unsigned iy = hy.begin; iy < hy.end; ++iy) {
                            for (unsigned ix = hx.begin; ix < hx.end; ++ix) {
                                f(2 * z + iz, 2 * y + iy, 2 * x + ix, values[4 * iz + 2 * iy + ix]);
                            }
                        }
                    }
                }
            }
        }
    }
};

}  // namespace octobrick::codec::detail
