// What a reader does for any bytes: open, check, count.

#include <algorithm>
#include <bit>

#include "faults.h"
#include "guarded_parallel.h"
#include "zerobit_reader.h"
#include "zerobit_synthesis.h"

namespace octobrick::codec {
namespace detail {
namespace {

// Walks over one unit block of `size` bytes; true where an encoder can have written it. `inside`
// has the flags of the cells that lie in the volume.
bool well_formed(const std::uint8_t* from, std::size_t size, std::uint64_t inside,
                 const ZerobitHeader& h) {
    const std::size_t cells = from[0];
    if (cells == 0) return size == 1;
    const std::size_t head = 9 + kCellInfoNbytes * cells;
    if (cells > kCells || size < head) return false;
    const auto flags = load<std::uint64_t>(from + 1);
    if ((flags & ~inside) != 0 || static_cast<std::size_t>(std::popcount(flags)) != cells) {
        return false;
    }
    const std::uint8_t* const streams = from + head;
    const std::size_t streams_nbytes = size - head;
    std::size_t maps_nbytes = 0, details = 0;  // so far
    std::size_t starts[kCells];                // of each cell's details
    for (std::size_t k = 0; k < cells; ++k) {
        const std::uint8_t* const info = from + 9 + kCellInfoNbytes * k;
        const auto zerobit = load<std::uint16_t>(info + 3);
        if (info[0] >= h.average_count || (zerobit & 0x7fffu) != maps_nbytes ||
            maps_nbytes >= streams_nbytes) {
            return false;
        }
        const std::uint8_t zerobits = streams[maps_nbytes++];
        const unsigned level0 = zerobit >> 15;
        const auto count = level0 + static_cast<unsigned>(std::popcount(zerobits));
        if (count > streams_nbytes - maps_nbytes) return false;
        starts[k] = details;
        for (unsigned m = 0; m < count; ++m) {
            const std::uint8_t map = streams[maps_nbytes++];
            const bool marks_level0 = (map & 0x80u) != 0;
            if ((map & 0x7fu) == 0 || marks_level0 != (level0 != 0 && m == 0)) return false;
            details += static_cast<std::size_t>(std::popcount(map & 0x7fu));
        }
    }
    if (maps_nbytes + details != streams_nbytes) return false;
    for (std::size_t k = 0; k < cells; ++k) {
        const std::uint8_t* const info = from + 9 + kCellInfoNbytes * k;
        if (load<std::uint16_t>(info + 1) != maps_nbytes + starts[k]) return false;
    }
    return std::all_of(streams + maps_nbytes, streams + streams_nbytes,
                       [&h](std::uint8_t index) { return index < h.detail_count; });
}

// The flags of the cells of a unit block that lie in the volume.
std::uint64_t cells_inside(const ZerobitHeader& h, Zyx block) {
    const Zyx cells = ceil_div(h.shape, kCell);
    std::uint64_t inside = 0;
    for (unsigned number = 0; number < kCells; ++number) {
        const bool in = 4 * block.z + number / 16 < cells.z &&
                        4 * block.y + number / 4 % 4 < cells.y &&
                        4 * block.x + number % 4 < cells.x;
        inside |= std::uint64_t{in} << number;
    }
    return inside;
}

Zyx position(const ZerobitHeader& h, std::size_t index) {
    return {index / (h.grid.y * h.grid.x), index / h.grid.x % h.grid.y, index % h.grid.x};
}

std::uint32_t pointer(const ZerobitHeader& h, const std::uint8_t* code, std::size_t index) {
    return load<std::uint32_t>(code + h.pointers_at + sizeof(std::uint32_t) * index);
}

}  // namespace
}  // namespace detail

using namespace detail;

ZerobitReader::ZerobitReader(std::span<const std::byte> code, const ZerobitHeader& header)
    : code_(reinterpret_cast<const std::uint8_t*>(code.data())), header_(header) {}

ZerobitOutcome ZerobitReader::open(std::span<const std::byte> code,
                                   std::span<const std::byte> codebook,
                                   std::unique_ptr<ZerobitReader>& reader) {
    ZerobitHeader h;
    const ZerobitOutcome outcome = read_header(code, h);
    if (outcome.status != ZerobitStatus::ok) return outcome;
    Codebook book;
    if (h.shared) {
        if (!read_codebook(codebook, book) || digest(codebook) != h.digest || book.type != h.type ||
            book.channels != h.channels || book.averages.size() != h.average_count ||
            book.details.size() != h.detail_count) {
            return {ZerobitStatus::wrong_codebook, {}, 0, 0};
        }
    } else {
        book.type = h.type;
        book.channels = h.channels;
        if (!read_codewords(code.subspan(kHeaderNbytes, h.codebook_nbytes), h.average_count,
                            h.detail_count, book)) {
            return {ZerobitStatus::bad_header, {}, 0, 0};
        }
    }
    reader = make_reader(code, h, book);
    return {};
}

float ZerobitReader::threshold(std::size_t block) const {
    return static_cast<float>(code_[header_.thresholds_at + block]) * header_.threshold_step;
}

const std::uint8_t* ZerobitReader::block(std::size_t index) const {
    return code_ + header_.blocks_at + pointer(header_, code_, index);
}

ZerobitOutcome ZerobitReader::check_block(std::size_t index) const {
    const std::size_t begin = pointer(header_, code_, index);
    const std::size_t end =
        index + 1 < header_.blocks ? pointer(header_, code_, index + 1) : header_.blocks_nbytes;
    const Zyx at = position(header_, index);
    if ((index == 0 && begin != 0) || begin >= end || end > header_.blocks_nbytes ||
        !well_formed(code_ + header_.blocks_at + begin, end - begin, cells_inside(header_, at),
                     header_)) {
        return {ZerobitStatus::bad_block, at, 0, 0};
    }
    return {};
}

ZerobitOutcome ZerobitReader::check_block(Zyx block) const {
    return check_block((block.z * header_.grid.y + block.y) * header_.grid.x + block.x);
}

ZerobitOutcome ZerobitReader::check(unsigned threads) const {
    FirstFaultOf<ZerobitOutcome> fault;
    threads = choose_threads(threads, header_.nbytes, header_.blocks);
    guarded_parallel_for(header_.blocks, threads, [&](std::size_t index, unsigned) {
        fault.report(index, check_block(index));
    });
    return fault.outcome();
}

ZerobitStats ZerobitReader::stats() const {
    ZerobitStats stats;
    for (std::size_t index = 0; index < header_.blocks; ++index) {
        const std::uint8_t* const from = block(index);
        for (unsigned number = 0; number < kCells; ++number) {
            const std::uint8_t* const info = find_cell(from, number);
            if (info == nullptr) continue;
            const CellView cell(info, streams_of(from));
            const auto level1 = static_cast<unsigned>(std::popcount(*cell.zerobits));
            stats.cells += 1;
            stats.null_nodes[0] += 1 - cell.level0;
            stats.null_nodes[1] += 8 - level1;
            for (unsigned m = 0; m < cell.level0 + level1; ++m) {
                stats.details += static_cast<std::size_t>(std::popcount(cell.maps()[m] & 0x7fu));
            }
        }
    }
    return stats;
}

}  // namespace octobrick::codec
