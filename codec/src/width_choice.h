// Which width each block gets: bits go where they lower the squared error most.
//
// For every block the error is known for every width. On the lower convex hull of (bits, error),
// each step to the next width has a slope: the squared error that one bit saves. Taking steps in
// the order of their slopes gives the least error for every total that it passes (Shoham, Gersho,
// "Efficient bit allocation for an arbitrary set of quantizers", 1988).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace octobrick::codec::detail {

inline constexpr std::size_t kWidths = 16;  // 0 to 14, raw

// The squared error of a block for each width; infinite where a width is not to be had.
struct BlockCurve {
    std::array<double, kWidths> squares;
    std::uint16_t predicted = 0;  // bit w: width w is better as a difference
};

// A step of a block from one width on its hull to the next.
struct HullStep {
    std::uint32_t units;  // in all steps of a hull, slopes fall
    double slope;         // squared error saved by a unit
    std::uint8_t width;   // after it
};

// The steps of a curve's hull, from width 0 on. `raw_units` is what a raw block takes.
std::size_t hull_of(const BlockCurve& curve, std::uint32_t raw_units,
                    std::array<HullStep, kWidths>& steps);

// Takes steps in the order of falling slopes, those of equal slope in the order of blocks, while
// they fit `units`; the first that does not fit ends it. Writes a width for every block.
void choose_widths(std::span<const BlockCurve> curves, std::uint32_t raw_units, std::uint64_t units,
                   std::span<std::uint8_t> widths);

// Takes every step of this slope or more.
void choose_widths_by_slope(std::span<const BlockCurve> curves, std::uint32_t raw_units,
                            double slope, std::span<std::uint8_t> widths);

}  // namespace octobrick::codec::detail
