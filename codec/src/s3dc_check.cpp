#include "s3dc_check.h"

#include <algorithm>
#include <cstring>

namespace octobrick::codec::detail {
namespace {

// The end points of a line of blocks over the whole length of x.
template <class T>
Outcome check_end_points(const std::byte* from, Zyx block, std::size_t blocks, SampleType type) {
    for (; block.x < blocks; ++block.x, from += 2 * sizeof(T)) {
        T ends[2];
        std::memcpy(ends, from, sizeof ends);
        if (!plausible(ends[0], ends[1], type)) {
            return bad_end_points(block, ends[0], ends[1], type);
        }
    }
    return {};
}

Outcome check_end_points(const std::byte* from, Zyx block, std::size_t blocks, SampleType type) {
    switch (sample_nbytes(type)) {
        case 1: return check_end_points<std::uint8_t>(from, block, blocks, type);
        case 2: return check_end_points<std::uint16_t>(from, block, blocks, type);
        default: return check_end_points<float>(from, block, blocks, type);
    }
}

}  // namespace

Outcome check_code(const S3dc& codec, SampleType type, Zyx shape, std::span<const std::byte> code,
                   Layout& layout) {
    if (const Status s = make_layout(codec, type, shape, layout); s != Status::ok) {
        return {s, {}, 0, 0};
    }
    if (code.size() != layout.nbytes) {
        return {Status::wrong_nbytes, {}, 0, 0};
    }
    const auto used = static_cast<unsigned>(shape.x * codec.bits % 16);  // of a row's last word
    const unsigned padding = used == 0 ? 0 : 0xffffu << used & 0xffffu;
    const std::size_t line_nbytes = layout.grid.x * 2 * sample_nbytes(type);
    const std::byte* ends = code.data();
    const std::byte* rows = ends + layout.end_points_nbytes;
    // In the order of decode's slabs, so that of several faults the same one is found.
    for (Zyx block; block.z < layout.grid.z; ++block.z) {
        for (block.y = 0; block.y < layout.grid.y; ++block.y, ends += line_nbytes) {
            const Outcome outcome = check_end_points(ends, block, layout.grid.x, type);
            if (outcome.status != Status::ok) return outcome;
            const std::size_t z0 = block.z * codec.block.z, y0 = block.y * codec.block.y;
            for (std::size_t z = z0; z < z0 + std::min(codec.block.z, shape.z - z0); ++z) {
                for (std::size_t y = y0; y < y0 + std::min(codec.block.y, shape.y - y0); ++y) {
                    std::uint16_t last;
                    std::memcpy(&last, rows + (z * shape.y + y + 1) * layout.row_nbytes - 2, 2);
                    if ((last & padding) != 0) return {Status::bad_padding, {z, y, 0}, 0, 0};
                }
            }
        }
    }
    return {};
}

}  // namespace octobrick::codec::detail
