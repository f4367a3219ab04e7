// Vector quantisation: at most 256 codewords for all colours, by median cut.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "octobrick/codec/zerobit.h"

namespace octobrick::codec::detail {

// Different colours in lexicographic order, each with how often it occurs.
struct Palette {
    std::vector<ZerobitColour> colours;
    std::vector<std::uint64_t> counts;
};

// Adds colours, in any order, to a palette.
void add_colours(Palette& palette, std::vector<ZerobitColour> colours);

// At most 256 codewords: the means of the boxes, rounded half up (f32: to float).
// Heckbert, "Color Image Quantization for Frame Buffer Display", 1982.
std::vector<ZerobitColour> median_cut(const Palette& palette, bool whole_numbers);

// The nearest codeword of every colour, of several the first. `codewords` must not be empty.
std::vector<std::uint8_t> nearest(std::span<const ZerobitColour> colours,
                                  std::span<const ZerobitColour> codewords, unsigned threads);

}  // namespace octobrick::codec::detail
