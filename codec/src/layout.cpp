#include "octobrick/codec/s3dc.h"
#include "rows.h"
#include "scales.h"

namespace octobrick::codec {

namespace {
std::size_t ceil_div(std::size_t a, std::size_t b) { return a / b + (a % b != 0); }
}  // namespace

Status make_layout(const S3dc& codec, SampleType type, Zyx shape, Layout& layout) noexcept {
    using detail::checked_mul;
    using detail::checked_volume;

    if (codec.bits < 1 || codec.bits > 8) {
        return Status::bad_bits;
    }
    if (codec.block.z == 0 || codec.block.y == 0 || codec.block.x == 0) {
        return Status::bad_block;
    }
    if (shape.z == 0 || shape.y == 0 || shape.x == 0) {
        return Status::empty_shape;
    }
    layout.grid = {ceil_div(shape.z, codec.block.z), ceil_div(shape.y, codec.block.y),
                   ceil_div(shape.x, codec.block.x)};

    std::size_t voxels_nbytes, row_nbits, rows_nbytes;
    const bool fits =
        checked_volume(shape, sample_nbytes(type), voxels_nbytes) &&
        checked_volume(layout.grid, 2 * sample_nbytes(type), layout.end_points_nbytes) &&
        checked_mul(shape.x, codec.bits, row_nbits);
    if (!fits) {
        return Status::too_large;
    }
    layout.row_nbytes = 2 * ceil_div(row_nbits, 16);  // whole 16-bit words, as textures take them
    if (!checked_volume({shape.z, shape.y, 1}, layout.row_nbytes, rows_nbytes)) {
        return Status::too_large;
    }
    layout.scales_begin = layout.end_points_nbytes + rows_nbytes;  // below 2^64: both below 2^63
    layout.nbytes = layout.scales_begin;
    if (codec.scaled && layout.nbytes <= PTRDIFF_MAX) {
        const std::size_t blocks = layout.grid.z * layout.grid.y * layout.grid.x;
        layout.nbytes += detail::scales_nbytes(codec.bits) + ceil_div(blocks, 2);
    }
    return layout.nbytes <= PTRDIFF_MAX ? Status::ok : Status::too_large;
}

}  // namespace octobrick::codec
