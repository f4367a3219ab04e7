#include "zerobit_flags.h"

#include <algorithm>
#include <array>
#include <type_traits>
#include <vector>

#include "simd.h"
#include "zerobit_synthesis.h"

namespace octobrick::bench {
namespace {

using namespace codec;
using namespace codec::detail;

// A unit block: the number of its cells that are not null, their flags, an entry for each (flags of
// 64 coefficients, two bytes of where its indices begin), indices. Flag 0 is the average, which
// every cell has; flag j is detail j of level 0, flag 1 + 7 (node + 1) + (j - 1) one of level 1.
constexpr std::size_t kEntryNbytes = 10, kEntriesAt = 9;
constexpr unsigned first_flag(unsigned node) { return 8 + 7 * node; }

struct Blocks {
    std::vector<std::uint8_t> bytes;
    std::vector<std::uint32_t> pointers;
};

void append_block(const std::uint8_t* block, std::vector<std::uint8_t>& to) {
    to.push_back(block[0]);
    if (block[0] == 0) return;
    to.insert(to.end(), block + 1, block + 9);
    std::vector<std::uint8_t> indices;
    for (unsigned number = 0; number < kCells; ++number) {
        const std::uint8_t* const info = find_cell(block, number);
        if (info == nullptr) continue;
        const CellView cell(info, streams_of(block));
        std::uint64_t flags = 1;
        unsigned map = 0;
        if (cell.level0 != 0) flags |= std::uint64_t{cell.maps()[map++] & 0x7fu} << 1;
        for (unsigned node = 0; node < 8; ++node) {
            if (!cell.has(node)) continue;
            flags |= std::uint64_t{cell.maps()[map++] & 0x7fu} << first_flag(node);
        }
        std::uint8_t entry[kEntryNbytes];
        store(entry, flags);
        store(entry + 8, static_cast<std::uint16_t>(indices.size()));
        to.insert(to.end(), entry, entry + kEntryNbytes);
        indices.push_back(cell.average);
        indices.insert(indices.end(), cell.details, cell.details + std::popcount(flags) - 1);
    }
    to.insert(to.end(), indices.begin(), indices.end());
}

Blocks recode(const std::uint8_t* code, const ZerobitHeader& header) {
    Blocks blocks;
    for (std::size_t index = 0; index < header.blocks; ++index) {
        blocks.pointers.push_back(static_cast<std::uint32_t>(blocks.bytes.size()));
        const auto at = load<std::uint32_t>(code + header.pointers_at + 4 * index);
        append_block(code + header.blocks_at + at, blocks.bytes);
    }
    blocks.bytes.resize(blocks.bytes.size() + kTailNbytes);
    return blocks;
}

struct TableCount {
    TableCount() {
        for (unsigned k = 1; k < of.size(); ++k)
            of[k] = static_cast<std::uint8_t>(of[k / 2] + k % 2);
    }
    // Of the flags before number `end`, 0 to 63.
    unsigned operator()(std::uint64_t flags, unsigned end) const {
        unsigned count = 0;
        for (; end >= 16; end -= 16, flags >>= 16) count += of[flags & 0xffff];
        return count + of[flags & low_bits(end)];
    }
    std::vector<std::uint8_t> of = std::vector<std::uint8_t>(65536);
};

struct InstructionCount {
    unsigned operator()(std::uint64_t flags, unsigned end) const {
        return static_cast<unsigned>(std::popcount(flags & low_bits(end)));
    }
};

template <class T, unsigned Channels, class Count>
class Reader final : public FlagsReader {
    using V = Lanes<std::int32_t, Channels>;
    static constexpr std::size_t kUnit = Channels * sizeof(T);

  public:
    Reader(const std::uint8_t* code, const ZerobitHeader& header, const Codebook& book)
        : header_(header),
          blocks_(recode(code, header)),
          least_(static_cast<std::int32_t>(header.least)),
          greatest_(static_cast<std::int32_t>(header.greatest)) {
        for (unsigned c = 0; c < Channels; ++c) {
            background_[c] = static_cast<T>(header.background[c]);
            for (std::size_t k = 0; k < book.averages.size(); ++k) {
                averages_[k].at[c] = static_cast<std::int32_t>(book.averages[k][c]);
            }
            for (std::size_t k = 0; k < book.details.size(); ++k) {
                details_[k].at[c] = static_cast<std::int32_t>(book.details[k][c]);
            }
        }
    }

    std::size_t nbytes() const override {
        return header_.nbytes - header_.blocks_nbytes - kTailNbytes + blocks_.bytes.size();
    }

    void voxels(std::span<const Zyx> at, std::byte* out) const override {
        if constexpr (kInstruction) {
            voxels_with_bits(at, out);
        } else {
            read_voxels(at, out);
        }
    }

    void cells(std::span<const Zyx> at, std::byte* out) const override {
        if constexpr (kInstruction) {
            cells_with_bits(at, out);
        } else {
            read_cells(at, out);
        }
    }

  private:
    static constexpr bool kInstruction = std::is_same_v<Count, InstructionCount>;

    struct Entry {
        std::uint64_t flags;
        const std::uint8_t* indices;
    };

    OCTOBRICK_BITS_TARGET void voxels_with_bits(std::span<const Zyx> at, std::byte* out) const {
        read_voxels(at, out);
    }
    OCTOBRICK_BITS_TARGET void cells_with_bits(std::span<const Zyx> at, std::byte* out) const {
        read_cells(at, out);
    }

    // Up to Together cells that are found step by step, so that memory is fetched ahead, as in
    // zerobit's own reader.
    template <std::size_t Together>
    struct Batch {
        const std::uint8_t *blocks[Together], *entries[Together];
    };

    template <std::size_t Together, class CellOf>
    void find_all(std::size_t count, const CellOf& cell_of, Batch<Together>& batch) const {
        auto& [blocks, entries] = batch;
        for (std::size_t k = 0; k < count; ++k) {
            blocks[k] = block_of(cell_of(k));
            __builtin_prefetch(blocks[k]);
        }
        for (std::size_t k = 0; k < count; ++k) {
            entries[k] = find(blocks[k], cell_of(k));
            __builtin_prefetch(entries[k]);
        }
        for (std::size_t k = 0; k < count; ++k) {
            if (entries[k] != nullptr) __builtin_prefetch(entry(blocks[k], entries[k]).indices);
        }
    }

    void read_voxels(std::span<const Zyx> at, std::byte* out) const {
        Batch<64> batch;
        for (; !at.empty(); at = at.subspan(std::min<std::size_t>(at.size(), 64))) {
            const std::size_t count = std::min<std::size_t>(at.size(), 64);
            const auto cell_of = [at](std::size_t k) {
                return Zyx{at[k].z / kCell, at[k].y / kCell, at[k].x / kCell};
            };
            find_all(count, cell_of, batch);
            for (std::size_t k = 0; k < count; ++k, out += kUnit) {
                if (batch.entries[k] == nullptr) {
                    std::memcpy(out, &background_, kUnit);
                } else {
                    put(voxel(entry(batch.blocks[k], batch.entries[k]), at[k]), out);
                }
            }
        }
    }

    void read_cells(std::span<const Zyx> at, std::byte* out) const {
        Batch<16> batch;
        for (; !at.empty(); at = at.subspan(std::min<std::size_t>(at.size(), 16))) {
            const std::size_t count = std::min<std::size_t>(at.size(), 16);
            find_all(count, [at](std::size_t k) { return at[k]; }, batch);
            for (std::size_t k = 0; k < count; ++k, out += kCells * kUnit) {
                write_cell(batch.blocks[k], batch.entries[k], out);
            }
        }
    }

    // The average, and seven details of each level, each by its flag.
    V voxel(const Entry& entry, Zyx at) const {
        const auto z = static_cast<unsigned>(at.z), y = static_cast<unsigned>(at.y),
                   x = static_cast<unsigned>(at.x);
        V value = averages_[entry.indices[0]];
        add_node(entry, 1, z / 2 % 2 + y / 2 % 2 * 2 + x / 2 % 2 * 4, value);
        const unsigned node = z / 2 % 2 * 4 + y / 2 % 2 * 2 + x / 2 % 2;
        add_node(entry, first_flag(node), z % 2 + y % 2 * 2 + x % 2 * 4, value);
        return value;
    }

    // `letters` as those of a detail's number lie: x, y, z.
    void add_node(const Entry& entry, unsigned flag, unsigned letters, V& value) const {
        for (unsigned j = 1; j < 8; ++j, ++flag) {
            if ((entry.flags >> flag & 1) == 0) continue;
            const V& detail = details_[entry.indices[count_(entry.flags, flag)]];
            value = add_or_subtract((std::popcount(letters & j) & 1) != 0, value, detail);
        }
    }

    // All coefficients in their order, so that no flags are counted; then nine transforms.
    void write_cell(const std::uint8_t* block, const std::uint8_t* found, std::byte* out) const {
        if (found == nullptr) {
            for (unsigned k = 0; k < kCells; ++k) std::memcpy(out + k * kUnit, &background_, kUnit);
            return;
        }
        const Entry from = entry(block, found);
        const std::uint8_t* next = from.indices;
        const Part all;
        V node[8] = {averages_[*next++]}, parents[8], values[8];
        decode_node(from.flags >> 1, next, node);
        haar_inverse(node, all, all, all, parents);
        for (unsigned n = 0; n < 8; ++n) {
            node[0] = parents[n];
            decode_node(from.flags >> first_flag(n), next, node);
            haar_inverse(node, all, all, all, values);
            for (unsigned k = 0; k < 8; ++k) {
                const unsigned z = n / 4 * 2 + k / 4, y = n / 2 % 2 * 2 + k / 2 % 2,
                               x = n % 2 * 2 + k % 2;
                put(values[k], out + (16 * z + 4 * y + x) * kUnit);
            }
        }
    }

    void decode_node(std::uint64_t flags, const std::uint8_t*& next, V (&node)[8]) const {
        for (unsigned j = 1; j < 8; ++j, flags >>= 1) {
            node[j] = (flags & 1) != 0 ? details_[*next++] : V{};
        }
    }

    const std::uint8_t* block_of(Zyx cell) const {
        const Zyx& grid = header_.grid;
        const std::size_t index = (cell.z / 4 * grid.y + cell.y / 4) * grid.x + cell.x / 4;
        return blocks_.bytes.data() + blocks_.pointers[index];
    }

    // Where the entry of a cell is; null where the cell is.
    const std::uint8_t* find(const std::uint8_t* block, Zyx cell) const {
        if (block[0] == 0) return nullptr;
        const auto number = static_cast<unsigned>(cell.z % 4 * 16 + cell.y % 4 * 4 + cell.x % 4);
        const auto flags = load<std::uint64_t>(block + 1);
        if ((flags >> number & 1) == 0) return nullptr;
        return block + kEntriesAt + kEntryNbytes * count_(flags, number);
    }

    static Entry entry(const std::uint8_t* block, const std::uint8_t* at) {
        const std::uint8_t* const indices = block + kEntriesAt + kEntryNbytes * block[0];
        return {load<std::uint64_t>(at), indices + load<std::uint16_t>(at + 8)};
    }

    void put(V value, std::byte* out) const {
        std::array<T, Channels> samples;
        for (unsigned c = 0; c < Channels; ++c) {
            samples[c] = static_cast<T>(std::min(std::max(value.at[c], least_), greatest_));
        }
        std::memcpy(out, &samples, kUnit);
    }

    Count count_;
    ZerobitHeader header_;
    Blocks blocks_;
    std::int32_t least_, greatest_;
    V averages_[kCodewords] = {}, details_[kCodewords] = {};
    std::array<T, Channels> background_{};
};

template <class Count>
std::unique_ptr<FlagsReader> reader(const std::uint8_t* code, const ZerobitHeader& header,
                                    const Codebook& book) {
    return with_sample_type(header.type, [&](auto zero) -> std::unique_ptr<FlagsReader> {
        using T = decltype(zero);
        if constexpr (std::is_floating_point_v<T>) {
            return nullptr;
        } else if (header.channels == 1) {
            return std::make_unique<Reader<T, 1, Count>>(code, header, book);
        } else {
            return std::make_unique<Reader<T, 3, Count>>(code, header, book);
        }
    });
}

}  // namespace

std::unique_ptr<FlagsReader> recode_with_flags(std::span<const std::byte> code,
                                               const ZerobitHeader& header, Counting counting) {
    Codebook book{header.type, header.channels, {}, {}};
    if (header.shared || !read_codewords(code.subspan(kHeaderNbytes), header.average_count,
                                         header.detail_count, book)) {
        return nullptr;
    }
    const auto* const bytes = reinterpret_cast<const std::uint8_t*>(code.data());
    if (counting == Counting::table) return reader<TableCount>(bytes, header, book);
    return has_avx2() ? reader<InstructionCount>(bytes, header, book) : nullptr;
}

}  // namespace octobrick::bench
