// The lossy half of encoding: transform, rank, threshold. All numbers are double, in which the
// sums of integer samples are exact.
#pragma once

#include <vector>

#include "octobrick/codec/zerobit.h"
#include "zerobit_format.h"

namespace octobrick::codec::detail {

inline constexpr unsigned kNodes = 9;        // detail nodes of a cell: 0 is level 0, 1 to 8 level 1
inline constexpr unsigned kNodeDetails = 7;  // of a node

struct Analysis {
    ZerobitVolume volume;
    ZerobitSettings settings;
    std::span<const std::uint8_t> wanted;  // per cell, or empty: all
    Zyx cells;                             // per axis
    Zyx grid;                              // unit blocks per axis
    ZerobitColour background;
    double least, greatest;  // of the wanted voxels
    std::size_t wanted_cells;

    std::size_t blocks() const { return grid.z * grid.y * grid.x; }
};

// What is kept of a cell that is not null.
struct KeptCell {
    std::uint8_t number;        // in its unit block
    std::uint8_t maps[kNodes];  // bit j - 1: detail j is kept
};

// What is kept of a unit block. Details lie cell after cell, in the order of nodes and bits.
struct KeptBlock {
    std::vector<KeptCell> cells;
    std::vector<ZerobitColour> averages, details;
    double dropped = 0;  // the greatest norm of a detail that is not kept, as one of level 1
};

// Looks at every voxel: fills all of `analysis` from volume, settings and wanted.
ZerobitOutcome survey(Analysis& analysis, unsigned threads);

// The details and averages of the whole volume that the settings let live, by unit block.
std::vector<KeptBlock> keep_significant(const Analysis& analysis, unsigned threads);

}  // namespace octobrick::codec::detail
