// Trained scales: where the indices of a block lie between its end points. docs/spec/s3dc.md.
//
// The S3Dc paper names an index distribution that is not linear, found by an analysis of the data,
// as future work (section 6). Eight scales are shared by a code; each block names one. Scale 0 is
// the linear one, so no block is worse off than without.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "octobrick/codec/s3dc.h"

namespace octobrick::codec::detail {

inline constexpr std::size_t kScales = 8;
inline constexpr std::size_t kMostIndices = 256;
inline constexpr unsigned kScaleTop = 65535;  // the position of the last index; the first has 0

// Position of every index on every scale.
using Scales = std::array<std::array<std::uint16_t, kMostIndices>, kScales>;

// What the positions take in a code.
constexpr std::size_t scales_nbytes(unsigned bits) {
    return kScales * sizeof(std::uint16_t) << bits;
}

// Scales for a finite volume. Depends on nothing but its voxels.
Scales train_scales(const S3dc& codec, const ConstVolume& voxels);

// How well each scale fits a block: adds up the squared distance of every position to the nearest
// index, with positions in 1024 steps.
class ScaleChooser {
  public:
    ScaleChooser(const Scales& scales, unsigned bits);
    // The scale of least error, the first of equals. Positions are at most kScaleTop.
    unsigned best(const std::uint16_t* positions, std::size_t n) const;
    // The index nearest to a step of positions.
    unsigned nearest(std::size_t scale, std::size_t step) const { return nearest_[scale][step]; }

    static constexpr std::size_t kSteps = 1024;
    static constexpr unsigned kStepShift = 6;

  private:
    std::vector<std::array<float, kScales>> squares_;
    std::array<std::array<std::uint8_t, kSteps>, kScales> nearest_;
};

}  // namespace octobrick::codec::detail
