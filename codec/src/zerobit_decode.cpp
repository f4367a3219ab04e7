#include <algorithm>

#include "guarded_parallel.h"
#include "simd.h"
#include "zerobit_reader.h"
#include "zerobit_synthesis.h"

namespace octobrick::codec::detail {
namespace {

template <class T, unsigned Channels>
class Reader final : public ZerobitReader {
    using Arithmetic = std::conditional_t<std::is_floating_point_v<T>, double, std::int32_t>;
    using V = Lanes<Arithmetic, Channels>;
    static constexpr std::size_t kUnit = Channels * sizeof(T);  // bytes of a voxel

  public:
    Reader(std::span<const std::byte> code, const ZerobitHeader& header, const Codebook& book)
        : ZerobitReader(code, header),
          least_(static_cast<Arithmetic>(header.least)),
          greatest_(static_cast<Arithmetic>(header.greatest)) {
        for (unsigned c = 0; c < Channels; ++c) {
            background_[c] = static_cast<T>(header.background[c]);
            for (std::size_t k = 0; k < book.averages.size(); ++k) {
                synthesis_.average.of[k].at[c] = static_cast<Arithmetic>(book.averages[k][c]);
            }
            for (std::size_t k = 0; k < book.details.size(); ++k) {
                synthesis_.detail.of[k].at[c] = static_cast<Arithmetic>(book.details[k][c]);
            }
        }
    }

    void voxels(std::span<const Zyx> at, std::byte* out) const override {
        bits_ ? voxels_with_bits(at, out) : read_voxels(at, out);
    }

    void plane(Zyx cell, unsigned axis, unsigned offset, std::byte* out) const override {
        bits_ ? plane_with_bits(cell, axis, offset, out) : read_plane(cell, axis, offset, out);
    }

    void cell(Zyx cell, std::byte* out) const override {
        bits_ ? cell_with_bits(cell, out) : read_whole_cell(cell, out);
    }

    void level(unsigned level, std::byte* out, unsigned threads) const override {
        const std::size_t nbytes = header_.shape.z * header_.shape.y * header_.shape.x * kUnit;
        threads = choose_threads(threads, nbytes >> (3 * level), header_.blocks);
        const Zyx shape = ceil_div(header_.shape, std::size_t{1} << level);
        guarded_parallel_for(header_.blocks, threads, [&](std::size_t index, unsigned) {
            bits_ ? level_with_bits(level, index, shape, out)
                  : level_block(level, index, shape, out);
        });
    }

  private:
    // The same bodies twice: see simd.h.
    OCTOBRICK_BITS_TARGET void voxels_with_bits(std::span<const Zyx> at, std::byte* out) const {
        read_voxels(at, out);
    }
    OCTOBRICK_BITS_TARGET void plane_with_bits(Zyx cell, unsigned axis, unsigned offset,
                                               std::byte* out) const {
        read_plane(cell, axis, offset, out);
    }
    OCTOBRICK_BITS_TARGET void cell_with_bits(Zyx cell, std::byte* out) const {
        read_whole_cell(cell, out);
    }
    OCTOBRICK_BITS_TARGET void level_with_bits(unsigned level, std::size_t index, Zyx shape,
                                               std::byte* out) const {
        level_block(level, index, shape, out);
    }

    // A code is small, but positions may lie anywhere in it: a few are looked up together, step by
    // step, so that the memory of one is fetched while others are worked on.
    void read_voxels(std::span<const Zyx> at, std::byte* out) const {
        constexpr std::size_t kTogether = 32;
        for (; !at.empty(); at = at.subspan(std::min(at.size(), kTogether))) {
            const std::size_t count = std::min(at.size(), kTogether);
            const std::uint8_t* from[kTogether];
            for (std::size_t k = 0; k < count; ++k) {
                from[k] = block(block_of({at[k].z / kCell, at[k].y / kCell, at[k].x / kCell}));
                __builtin_prefetch(from[k]);
            }
            // Which are null is hard to foresee: no jump depends on it.
            struct Found {
                const std::uint8_t* info;
                const std::uint8_t* streams;
                std::size_t k;
            } found[kTogether];
            std::size_t live = 0;
            for (std::size_t k = 0; k < count; ++k) {
                put_background(out + k * kUnit);
                const unsigned number = number_of(at[k]);
                found[live] = {info_of(from[k], number), streams_of(from[k]), k};
                __builtin_prefetch(found[live].info);
                live += has_cell(from[k], number);
            }
            CellView cells[kTogether];
            for (std::size_t i = 0; i < live; ++i) {
                cells[i] = CellView(found[i].info, found[i].streams);
                __builtin_prefetch(cells[i].zerobits);
                __builtin_prefetch(cells[i].details);
            }
            for (std::size_t i = 0; i < live; ++i) {
                const Zyx p = at[found[i].k];
                const auto z = static_cast<unsigned>(p.z % kCell),
                           y = static_cast<unsigned>(p.y % kCell),
                           x = static_cast<unsigned>(p.x % kCell);
                put(synthesis_.voxel(cells[i], z, y, x), out + found[i].k * kUnit);
            }
            out += count * kUnit;
        }
    }

    void read_plane(Zyx cell, unsigned axis, unsigned offset, std::byte* out) const {
        Part nodes[3], halves[3];
        nodes[axis] = Part::one(offset / 2);
        halves[axis] = Part::one(offset % 2);
        const unsigned row = axis == 0 ? 1 : 0, column = axis == 2 ? 1 : 2;
        read_cell(cell, nodes, halves, 16, out, [=](unsigned z, unsigned y, unsigned x) {
            const unsigned at[3] = {z, y, x};
            return 4 * at[row] + at[column];
        });
    }

    void read_whole_cell(Zyx cell, std::byte* out) const {
        const Part all[3];
        read_cell(cell, all, all, 64, out,
                  [](unsigned z, unsigned y, unsigned x) { return 16 * z + 4 * y + x; });
    }

    // The number in its unit block of a voxel's cell.
    static unsigned number_of(Zyx voxel) {
        return static_cast<unsigned>(16 * (voxel.z / 4 % 4) + 4 * (voxel.y / 4 % 4) +
                                     voxel.x / 4 % 4);
    }

    std::size_t block_of(Zyx cell) const {
        return (cell.z / 4 * header_.grid.y + cell.y / 4) * header_.grid.x + cell.x / 4;
    }

    void put(V value, std::byte* out) const {
        for (unsigned i = 0; i < V::kLanes; ++i) {
            value.at[i] = std::min(std::max(value.at[i], least_), greatest_);
        }
        T samples[Channels];
        for (unsigned c = 0; c < Channels; ++c) samples[c] = static_cast<T>(value.at[c]);
        std::memcpy(out, samples, sizeof samples);
    }

    void put_background(std::byte* out) const { std::memcpy(out, background_, kUnit); }

    // Writes the wanted voxels of one cell, each to where `place` says, or `count` of background.
    template <class Place>
    void read_cell(Zyx at, const Part (&nodes)[3], const Part (&halves)[3], unsigned count,
                   std::byte* out, const Place& place) const {
        const std::uint8_t* from = block(block_of(at));
        const auto number = static_cast<unsigned>(16 * (at.z % 4) + 4 * (at.y % 4) + at.x % 4);
        const std::uint8_t* info = find_cell(from, number);
        if (info == nullptr) {
            for (unsigned k = 0; k < count; ++k) put_background(out + k * kUnit);
            return;
        }
        synthesis_.each_voxel(CellView(info, streams_of(from)), nodes, halves,
                              [&](unsigned z, unsigned y, unsigned x, const V& value) {
                                  put(value, out + place(z, y, x) * kUnit);
                              });
    }

    // The values of one unit block at a level: side^3 per cell.
    void level_block(unsigned level, std::size_t index, Zyx shape, std::byte* out) const {
        const std::size_t side = kCell >> level;
        const Zyx first = {index / (header_.grid.y * header_.grid.x) * 4,
                           index / header_.grid.x % header_.grid.y * 4, index % header_.grid.x * 4};
        const std::uint8_t* from = block(index);
        for (unsigned number = 0; number < kCells; ++number) {
            const Zyx origin = {(first.z + number / 16) * side, (first.y + number / 4 % 4) * side,
                                (first.x + number % 4) * side};
            if (origin.z >= shape.z || origin.y >= shape.y || origin.x >= shape.x) continue;
            std::byte values[kCells * kUnit];
            level_cell(level, from, number, values);
            const std::size_t width = std::min(side, shape.x - origin.x);
            for (std::size_t z = 0; z < std::min(side, shape.z - origin.z); ++z) {
                for (std::size_t y = 0; y < std::min(side, shape.y - origin.y); ++y) {
                    const std::size_t row = (origin.z + z) * shape.y + origin.y + y;
                    std::memcpy(out + (row * shape.x + origin.x) * kUnit,
                                values + (z * side + y) * side * kUnit, width * kUnit);
                }
            }
        }
    }

    void level_cell(unsigned level, const std::uint8_t* from, unsigned number,
                    std::byte* out) const {
        const std::uint8_t* info = find_cell(from, number);
        if (info == nullptr) {
            const unsigned count = static_cast<unsigned>(kCells) >> (3 * level);
            for (unsigned k = 0; k < count; ++k) put_background(out + k * kUnit);
            return;
        }
        const CellView cell(info, streams_of(from));
        const Part all[3];
        V values[8];
        switch (level) {
            case 0:
                synthesis_.each_voxel(cell, all, all,
                                      [&](unsigned z, unsigned y, unsigned x, const V& value) {
                                          put(value, out + (16 * z + 4 * y + x) * kUnit);
                                      });
                break;
            case 1:
                synthesis_.averages(cell, all[0], all[1], all[2], values);
                for (unsigned k = 0; k < 8; ++k) put(values[k], out + k * kUnit);
                break;
            default: put(synthesis_.average[cell.average], out);
        }
    }

    Synthesis<V> synthesis_;
    Arithmetic least_, greatest_;
    T background_[Channels];
    bool bits_ = has_avx2();  // all processors that have AVX2 count bits
};

template <unsigned Channels>
std::unique_ptr<ZerobitReader> make_reader_of(std::span<const std::byte> code,
                                              const ZerobitHeader& h, const Codebook& book) {
    return with_sample_type(h.type, [&](auto zero) -> std::unique_ptr<ZerobitReader> {
        using T = decltype(zero);
        if constexpr (Channels == 1 || std::is_same_v<T, std::uint8_t> ||
                      std::is_same_v<T, std::uint16_t>) {
            return std::make_unique<Reader<T, Channels>>(code, h, book);
        } else {
            return nullptr;
        }
    });
}

}  // namespace

std::unique_ptr<ZerobitReader> make_reader(std::span<const std::byte> code, const ZerobitHeader& h,
                                           const Codebook& book) {
    return h.channels == 1 ? make_reader_of<1>(code, h, book) : make_reader_of<3>(code, h, book);
}

}  // namespace octobrick::codec::detail
