// Smoothing across the borders of blocks that were coded independently: docs/spec/deblocking.md.
//
// The functions are pure and thread-safe, do not throw but for lack of memory, and give the same on
// every number of threads.
#pragma once

#include <cstddef>
#include <span>

#include "octobrick/codec/view.h"

namespace octobrick::codec {

enum class DeblockAxes { average, sequential };
// How a bound q limits a change c.
enum class DeblockLimit {
    automatic,  // clamp where the block's range is at most 10 q, else c max(0, 1 - |c| / q)
    ramp,       // c max(0, 1 - (c / q)^2)
    clamp,      // to [-q, q]
};

struct Deblock {
    Zyx block;            // voxels per block, each at least 1
    double strength = 4;  // the paper's lambda: any finite number
    // What gradients are measured against, above 0; 0 takes the greatest voxel less the least.
    double value_range = 0;
    // The least and the greatest voxel of the whole, for a part of a volume; equal where there is
    // none. Then results lie within these instead, and do not depend on where the volume was cut.
    // Without effect where a voxel lies outside of them.
    double low = 0, high = 0;
    DeblockAxes axes = DeblockAxes::average;
    DeblockLimit limit = DeblockLimit::automatic;
};

// Writes the filtered voxels of a contiguous volume. `bounds` says by how much each voxel may be
// wrong, and so how far the filter may move it: empty (as far as it likes), one float per block, or
// one per voxel, none negative or NaN. `out` may not overlap the input. No axis is empty.
//
// Every result lies within the least and the greatest voxel. Returns the flat index of the first
// voxel that is NaN or infinite, with `out` unspecified; else kAllFinite.
//
// Needs 8 bytes a voxel and, with blocks of b, 16 b^2 bytes; the work per voxel grows with b.
std::size_t deblock(const Deblock& filter, std::span<const float> volume, Zyx shape,
                    std::span<const float> bounds, std::span<float> out, Execution execution = {});

}  // namespace octobrick::codec
