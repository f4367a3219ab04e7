#include <algorithm>
#include <array>

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
        for (unsigned k = 0; k < kCodewords; ++k) synthesis_.terms.set(k, synthesis_.detail.of[k]);
    }

    void voxels(std::span<const Zyx> at, std::byte* out) const override {
        bits_ ? voxels_with_bits(at, out) : read_voxels(at, out);
    }

    void plane(Zyx cell, unsigned axis, unsigned offset, std::byte* out) const override {
        bits_ ? plane_with_bits(cell, axis, offset, out) : read_plane(cell, axis, offset, out);
    }

    void cells(std::span<const Zyx> at, std::byte* out) const override {
        bits_ ? cells_with_bits(at, out) : read_cells(at, out);
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
    OCTOBRICK_BITS_TARGET void cells_with_bits(std::span<const Zyx> at, std::byte* out) const {
        read_cells(at, out);
    }
    OCTOBRICK_BITS_TARGET void level_with_bits(unsigned level, std::size_t index, Zyx shape,
                                               std::byte* out) const {
        level_block(level, index, shape, out);
    }

    // A code is small, but positions may lie anywhere in it: some are looked up together, step by
    // step, so that the memory of one is fetched while others are worked on. Which are null, and
    // which have a node of level 1, is hard to foresee: no jump depends on it.
    static constexpr std::size_t kTogether = 64;  // 32 and 128 were slower

    struct Found {
        CellView cell;
        V value;
        std::uint8_t node, half, k;
    };

    void read_voxels(std::span<const Zyx> at, std::byte* out) const {
        Found found[kTogether];
        std::uint8_t deep[kTogether + 1];  // one may be written before it is known to be wanted
        const Clamp clamp{least_, greatest_};
        for (; !at.empty(); at = at.subspan(std::min(at.size(), kTogether))) {
            const std::size_t count = std::min(at.size(), kTogether);
            const std::size_t live = find(at.first(count), out, found);
            std::size_t deep_count = 0;
            for (std::size_t i = 0; i < live; ++i) {
                Found& f = found[i];
                f.value = synthesis_.node_average(f.cell, f.node);
                deep[deep_count] = static_cast<std::uint8_t>(i);
                deep_count += f.cell.has(f.node);
            }
            for (std::size_t i = 0; i < deep_count; ++i) {
                Found& f = found[deep[i]];
                f.value = synthesis_.node_voxel(f.value, f.cell, f.node, f.half);
            }
            for (std::size_t i = 0; i < live; ++i) {
                put(clamp(found[i].value), out + found[i].k * kUnit);
            }
            out += count * kUnit;
        }
    }

    // Writes background for all positions, and finds the cells of those that are not null.
    std::size_t find(std::span<const Zyx> at, std::byte* out, Found* found) const {
        struct Place {
            const std::uint8_t* block;
            std::uint8_t cell, node, half;
        } places[kTogether];
        const std::uint8_t* const pointers = code_ + header_.pointers_at;
        const std::uint8_t* const blocks = code_ + header_.blocks_at;
        const Zyx grid = header_.grid;
        for (std::size_t k = 0; k < at.size(); ++k) {
            const auto [z, y, x] = at[k];
            const std::size_t index = (z / kBlock * grid.y + y / kBlock) * grid.x + x / kBlock;
            Place& place = places[k];
            place.block = blocks + load<std::uint32_t>(pointers + 4 * index);
            __builtin_prefetch(place.block);
            place.cell = static_cast<std::uint8_t>((z & 12) * 4 + (y & 12) + (x & 12) / 4);
            place.node = static_cast<std::uint8_t>((z & 2) * 2 + (y & 2) + (x & 2) / 2);
            place.half = static_cast<std::uint8_t>((z & 1) * 4 + (y & 1) * 2 + (x & 1));
        }
        for (std::size_t k = 0; k < at.size(); ++k) put(background_, out + k * kUnit);
        struct Info {
            const std::uint8_t *at, *streams;
            std::uint8_t node, half, k;
        } infos[kTogether + 1];  // likewise
        std::size_t live = 0;
        for (std::size_t k = 0; k < at.size(); ++k) {
            const Place& place = places[k];
            const std::uint64_t flags = flags_of(place.block);
            const std::uint8_t* const info = info_of(place.block, flags, place.cell);
            __builtin_prefetch(info);
            infos[live] = {info, streams_of(place.block), place.node, place.half,
                           static_cast<std::uint8_t>(k)};
            live += flags >> place.cell & 1;
        }
        for (std::size_t i = 0; i < live; ++i) {
            const Info& info = infos[i];
            Found& f = found[i];
            f.cell = CellView(info.at, info.streams);
            __builtin_prefetch(f.cell.zerobits);
            __builtin_prefetch(f.cell.details);
            f.node = info.node;
            f.half = info.half;
            f.k = info.k;
        }
        return live;
    }

    void read_plane(Zyx cell, unsigned axis, unsigned offset, std::byte* out) const {
        Part nodes[3], halves[3];
        nodes[axis] = Part::one(offset / 2);
        halves[axis] = Part::one(offset % 2);
        const unsigned row = axis == 0 ? 1 : 0, column = axis == 2 ? 1 : 2;
        const std::uint8_t* const from = block(block_of(cell));
        write_cell(find_cell(from, number_of(cell)), from, nodes, halves, 16, out,
                   [=](unsigned z, unsigned y, unsigned x) {
                       const unsigned at[3] = {z, y, x};
                       return 4 * at[row] + at[column];
                   });
    }

    // Step by step like voxels, but fewer together: a cell is much more work.
    void read_cells(std::span<const Zyx> at, std::byte* out) const {
        constexpr std::size_t kCellsTogether = 16;
        const std::uint8_t *blocks[kCellsTogether], *infos[kCellsTogether];
        const Part all[3];
        for (; !at.empty(); at = at.subspan(std::min(at.size(), kCellsTogether))) {
            const std::size_t count = std::min(at.size(), kCellsTogether);
            for (std::size_t k = 0; k < count; ++k) {
                blocks[k] = block(block_of(at[k]));
                __builtin_prefetch(blocks[k]);
            }
            for (std::size_t k = 0; k < count; ++k) {
                infos[k] = find_cell(blocks[k], number_of(at[k]));
                __builtin_prefetch(infos[k]);  // null is no address, and does no harm
            }
            for (std::size_t k = 0; k < count; ++k) {
                if (infos[k] == nullptr) continue;
                const CellView cell(infos[k], streams_of(blocks[k]));
                __builtin_prefetch(cell.zerobits);
                __builtin_prefetch(cell.details);
            }
            for (std::size_t k = 0; k < count; ++k, out += kCells * kUnit) {
                write_cell(infos[k], blocks[k], all, all, kCells, out,
                           [](unsigned z, unsigned y, unsigned x) { return 16 * z + 4 * y + x; });
            }
        }
    }

    // The number of a cell in its unit block.
    static unsigned number_of(Zyx cell) {
        return static_cast<unsigned>(16 * (cell.z % 4) + 4 * (cell.y % 4) + cell.x % 4);
    }

    std::size_t block_of(Zyx cell) const {
        return (cell.z / 4 * header_.grid.y + cell.y / 4) * header_.grid.x + cell.x / 4;
    }

    using Sample = std::array<T, Channels>;

    // A value as samples. By itself, so that no store through a pointer to bytes can change it.
    struct Clamp {
        Sample operator()(V value) const {
            for (unsigned i = 0; i < V::kLanes; ++i) {
                value.at[i] = std::min(std::max(value.at[i], least), greatest);
            }
            Sample sample;
            for (unsigned c = 0; c < Channels; ++c) sample[c] = static_cast<T>(value.at[c]);
            return sample;
        }
        Arithmetic least, greatest;
    };

    void put(V value, std::byte* out) const { put(Clamp{least_, greatest_}(value), out); }
    static void put(const Sample& sample, std::byte* out) { std::memcpy(out, &sample, kUnit); }
    void put_background(std::byte* out) const { put(background_, out); }

    // Writes the wanted voxels of the cell with this information in this unit block, each to where
    // `place` says, or `count` of background where there is none.
    template <class Place>
    void write_cell(const std::uint8_t* info, const std::uint8_t* from, const Part (&nodes)[3],
                    const Part (&halves)[3], unsigned count, std::byte* out,
                    const Place& place) const {
        if (info == nullptr) {
            for (unsigned k = 0; k < count; ++k) put_background(out + k * kUnit);
            return;
        }
        synthesis_.each_voxel(
            CellView(info, streams_of(from)), nodes, halves, Clamp{least_, greatest_},
            [out, place](unsigned z, unsigned y, unsigned x, const Sample& sample) {
                put(sample, out + place(z, y, x) * kUnit);
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
                synthesis_.each_voxel(
                    cell, all, all, Clamp{least_, greatest_},
                    [out](unsigned z, unsigned y, unsigned x, const Sample& sample) {
                        put(sample, out + (16 * z + 4 * y + x) * kUnit);
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
    Sample background_;
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
