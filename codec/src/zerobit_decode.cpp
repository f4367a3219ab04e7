#include <algorithm>

#include "guarded_parallel.h"
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
        for (const Zyx& p : at) {
            const std::uint8_t* from = block(block_of({p.z / kCell, p.y / kCell, p.x / kCell}));
            const auto z = static_cast<unsigned>(p.z), y = static_cast<unsigned>(p.y),
                       x = static_cast<unsigned>(p.x);
            const unsigned number = 16 * (z / 4 % 4) + 4 * (y / 4 % 4) + x / 4 % 4;
            if (from[0] != 0 && BlockView(from).has(number)) {
                const CellView cell(BlockView(from), number);
                put(synthesis_.voxel(cell, z % 4, y % 4, x % 4), out);
            } else {
                put_background(out);
            }
            out += kUnit;
        }
    }

    void plane(Zyx cell, unsigned axis, unsigned offset, std::byte* out) const override {
        Part nodes[3], halves[3];
        nodes[axis] = Part::one(offset / 2);
        halves[axis] = Part::one(offset % 2);
        const unsigned row = axis == 0 ? 1 : 0, column = axis == 2 ? 1 : 2;
        read_cell(cell, nodes, halves, 16, out, [=](unsigned z, unsigned y, unsigned x) {
            const unsigned at[3] = {z, y, x};
            return 4 * at[row] + at[column];
        });
    }

    void cell(Zyx cell, std::byte* out) const override {
        const Part all[3];
        read_cell(cell, all, all, 64, out,
                  [](unsigned z, unsigned y, unsigned x) { return 16 * z + 4 * y + x; });
    }

    void level(unsigned level, std::byte* out, unsigned threads) const override {
        const std::size_t nbytes = header_.shape.z * header_.shape.y * header_.shape.x * kUnit;
        threads = choose_threads(threads, nbytes >> (3 * level), header_.blocks);
        const Zyx shape = ceil_div(header_.shape, std::size_t{1} << level);
        guarded_parallel_for(header_.blocks, threads, [&](std::size_t index, unsigned) {
            level_block(level, index, shape, out);
        });
    }

  private:
    std::size_t block_of(Zyx cell) const {
        return (cell.z / 4 * header_.grid.y + cell.y / 4) * header_.grid.x + cell.x / 4;
    }

    void put(const V& value, std::byte* out) const {
        T samples[Channels];
        for (unsigned c = 0; c < Channels; ++c) {
            samples[c] = static_cast<T>(std::clamp(value.at[c], least_, greatest_));
        }
        std::memcpy(out, samples, sizeof samples);
    }

    void put_background(std::byte* out) const { std::memcpy(out, background_, kUnit); }

    // Writes the wanted voxels of one cell, each to where `place` says, or `count` of background.
    template <class Place>
    void read_cell(Zyx at, const Part (&nodes)[3], const Part (&halves)[3], unsigned count,
                   std::byte* out, const Place& place) const {
        const std::uint8_t* from = block(block_of(at));
        const auto number = static_cast<unsigned>(16 * (at.z % 4) + 4 * (at.y % 4) + at.x % 4);
        if (from[0] == 0 || !BlockView(from).has(number)) {
            for (unsigned k = 0; k < count; ++k) put_background(out + k * kUnit);
            return;
        }
        synthesis_.each_voxel(CellView(BlockView(from), number), nodes, halves,
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
        if (from[0] == 0 || !BlockView(from).has(number)) {
            const unsigned count = static_cast<unsigned>(kCells) >> (3 * level);
            for (unsigned k = 0; k < count; ++k) put_background(out + k * kUnit);
            return;
        }
        const CellView cell(BlockView(from), number);
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
