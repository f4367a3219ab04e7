// How many bits can be spent at which slope, over any number of volumes, in bounded memory.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace octobrick::codec::detail {

// A bin is a float's exponent and six bits of its mantissa: 1/64 wide.
class SlopeHistogram {
  public:
    void add(double slope, double nbits) { bins_[bin_of(slope)] += nbits; }

    // The least edge of a bin such that all steps above it need no more than `nbits`.
    double least_slope(double nbits) const {
        double sum = 0, least = std::numeric_limits<double>::infinity();
        for (std::size_t bin = bins_.size(); bin-- > 0 && sum + bins_[bin] <= nbits;) {
            sum += bins_[bin];
            if (bins_[bin] > 0) least = edge_of(bin);
        }
        return least;
    }

  private:
    static constexpr int kDropped = 23 - 6;  // bits of the mantissa
    static constexpr std::size_t kBins = std::size_t{1} << (31 - kDropped);

    static std::size_t bin_of(double slope) {
        using Limits = std::numeric_limits<float>;
        const double within = std::clamp(slope, double{Limits::min()}, double{Limits::max()});
        return std::bit_cast<std::uint32_t>(static_cast<float>(within)) >> kDropped;
    }
    static double edge_of(std::size_t bin) {
        const auto edge = std::bit_cast<float>(static_cast<std::uint32_t>(bin) << kDropped);
        return std::max(static_cast<double>(edge), 0.0);
    }

    std::vector<double> bins_ = std::vector<double>(kBins);
};

}  // namespace octobrick::codec::detail
