// S3Dc: fixed-rate, randomly accessible compression of scalar volumes.
//
// Yela, Navazo, Vázquez, "S3Dc: A 3Dc-based Volume Compression Algorithm", 2008: each block of
// voxels keeps its minimum and maximum (the end points, "MMV"); each voxel keeps an index of
// `bits` bits that places it between the two ("IV"). docs/spec/s3dc.md gives the bytes.
//
// What every function here promises:
//   - It throws nothing but std::bad_alloc, and that before it has written a byte.
//   - It is safe to call from any threads at once, as long as nobody writes what it reads, or
//     touches what it writes. It keeps no state, and no thread outlives the call.
//   - Its result does not depend on Execution, on the machine, or on how the volume is strided.
//   - Scratch memory is about 40 bytes per voxel of one row (x) and thread.
#pragma once

#include <cstddef>
#include <span>

#include "octobrick/codec/view.h"

namespace octobrick::codec {

// The parameters of the code. Blocks at the far faces are cut where the volume ends.
struct S3dc {
    Zyx block;      // voxels per block, at least 1 on each axis
    unsigned bits;  // per index, 1 to 8
    // Put end points where they lower the squared error, not at least and greatest voxel. Only the
    // encoder needs to know.
    bool fitted = false;
    // Behind the rows follow eight scales, of which each block names one: a form of its own. End
    // points are then least and greatest.
    bool scaled = false;
};

enum class Status : std::uint8_t {
    ok,
    bad_bits,        // bits outside 1..8
    bad_block,       // a block axis of 0
    empty_shape,     // a volume axis of 0
    too_large,       // the volume or its code has more bytes than ptrdiff_t can count
    wrong_nbytes,    // the code is not exactly as long as Layout::nbytes
    not_finite,      // NaN or an infinity; `at` is the first such voxel in memory order z, y, x
    bad_end_points,  // a minimum above its maximum, or not finite; `at` is the block, and
                     // `first` and `second` are its minimum and maximum
    bad_padding,     // bits behind the last index of a row are set; `at` is the row's first voxel
    // Of variable-rate codes; see s3dc_variable.h.
    bad_widths,
    budget_too_small,
    wrong_prediction,
    bad_groups,
    bad_raw,
    bad_scales,  // of a scaled code: positions out of order, or a choice that is none
};

// How a call ended. Of several faults the first one is reported, whatever the thread count.
struct Outcome {
    Status status = Status::ok;
    Zyx at;
    double first = 0, second = 0;
};

// Where the parts of a code lie. Bytes [0, end_points_nbytes) are the end points; rows of
// row_nbytes follow, one per (z, y), up to scales_begin; then, if there are any, scales.
struct Layout {
    Zyx grid;  // blocks per axis
    std::size_t end_points_nbytes = 0;
    std::size_t row_nbytes = 0;
    std::size_t scales_begin = 0;
    std::size_t nbytes = 0;
};

// Computes the layout of the code of a volume. Allocates nothing; any arguments are safe.
// Fails with bad_bits, bad_block, empty_shape or too_large.
Status make_layout(const S3dc& codec, SampleType type, Zyx shape, Layout& layout) noexcept;

// Writes the code of `voxels` to `code`, whose size must be Layout::nbytes.
// Fails as make_layout does, or with wrong_nbytes, or not_finite (f32 only); after not_finite the
// contents of `code` are unspecified. −0 as an end point is written as +0.
Outcome encode(const S3dc& codec, const ConstVolume& voxels, std::span<std::byte> code,
               Execution execution = {});

// Reads `voxels.shape` voxels of type `voxels.type` from `code`. Safe for hostile bytes.
// Fails as make_layout does, or with wrong_nbytes, bad_end_points or bad_padding; after the last
// two the contents of `voxels` are unspecified. Every voxel lies within its block's end points.
Outcome decode(const S3dc& codec, std::span<const std::byte> code, const Volume& voxels,
               Execution execution = {});

}  // namespace octobrick::codec
