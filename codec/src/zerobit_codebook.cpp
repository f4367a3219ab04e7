#include "zerobit_codebook.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "guarded_parallel.h"
#include "zerobit_format.h"

namespace octobrick::codec::detail {
namespace {

// Colours order[begin, end) of a palette.
struct Box {
    std::size_t begin, end;
    std::uint64_t count;  // with repetitions
    unsigned axis;        // the channel that is widest, of several the first
    double extent;        // there
};

class MedianCut {
  public:
    explicit MedianCut(const Palette& palette) : palette_(palette), order_(palette.colours.size()) {
        std::iota(order_.begin(), order_.end(), std::size_t{0});
        if (!order_.empty()) boxes_.push_back(box(0, order_.size()));
    }

    void cut() {
        while (boxes_.size() < kCodewords) {
            Box* most = nullptr;
            for (Box& b : boxes_) {
                if (b.end - b.begin > 1 && (most == nullptr || b.count > most->count)) most = &b;
            }
            if (most == nullptr) return;
            const std::size_t middle = sort_and_find_median(*most);
            const Box whole = *most;
            *most = box(whole.begin, middle);
            boxes_.push_back(box(middle, whole.end));
        }
    }

    std::vector<ZerobitColour> means(bool whole_numbers) const {
        std::vector<ZerobitColour> means;
        for (const Box& b : boxes_) {
            ZerobitColour mean{};
            for (std::size_t k = b.begin; k < b.end; ++k) {
                for (unsigned c = 0; c < 3; ++c) mean[c] += count(k) * colour(k)[c];
            }
            for (double& m : mean) {
                m /= static_cast<double>(b.count);
                m = whole_numbers ? std::floor(m + 0.5)
                                  : static_cast<double>(static_cast<float>(m));
            }
            means.push_back(mean);
        }
        return means;
    }

  private:
    const ZerobitColour& colour(std::size_t k) const { return palette_.colours[order_[k]]; }
    double count(std::size_t k) const { return static_cast<double>(palette_.counts[order_[k]]); }

    Box box(std::size_t begin, std::size_t end) const {
        Box b{begin, end, 0, 0, -1};
        for (std::size_t k = begin; k < end; ++k) b.count += palette_.counts[order_[k]];
        for (unsigned c = 0; c < 3; ++c) {
            double least = colour(begin)[c], greatest = least;
            for (std::size_t k = begin; k < end; ++k) {
                least = std::min(least, colour(k)[c]);
                greatest = std::max(greatest, colour(k)[c]);
            }
            if (greatest - least > b.extent) {
                b.extent = greatest - least;
                b.axis = c;
            }
        }
        return b;
    }

    // Where the second half of the box's colours begins; both halves have at least one.
    std::size_t sort_and_find_median(const Box& b) {
        const auto at = [this](std::size_t k) {
            return order_.begin() + static_cast<std::ptrdiff_t>(k);
        };
        std::stable_sort(at(b.begin), at(b.end), [&](std::size_t i, std::size_t j) {
            return palette_.colours[i][b.axis] < palette_.colours[j][b.axis];
        });
        std::uint64_t before = 0;
        for (std::size_t k = b.begin; k + 1 < b.end; ++k) {
            before += palette_.counts[order_[k]];
            if (2 * before >= b.count) return k + 1;
        }
        return b.end - 1;
    }

    const Palette& palette_;
    std::vector<std::size_t> order_;
    std::vector<Box> boxes_;
};

}  // namespace

void add_colours(Palette& palette, std::vector<ZerobitColour> colours) {
    std::sort(colours.begin(), colours.end());
    Palette merged;
    const auto append = [&merged](const ZerobitColour& colour, std::uint64_t count) {
        if (merged.colours.empty() || merged.colours.back() != colour) {
            merged.colours.push_back(colour);
            merged.counts.push_back(0);
        }
        merged.counts.back() += count;
    };
    std::size_t old = 0;
    for (const ZerobitColour& colour : colours) {
        for (; old < palette.colours.size() && palette.colours[old] <= colour; ++old) {
            append(palette.colours[old], palette.counts[old]);
        }
        append(colour, 1);
    }
    for (; old < palette.colours.size(); ++old) append(palette.colours[old], palette.counts[old]);
    palette = std::move(merged);
}

std::vector<ZerobitColour> median_cut(const Palette& palette, bool whole_numbers) {
    MedianCut cut(palette);
    cut.cut();
    return cut.means(whole_numbers);
}

std::vector<std::uint8_t> nearest(std::span<const ZerobitColour> colours,
                                  std::span<const ZerobitColour> codewords, unsigned threads) {
    // Codewords by channel, so that the distances to several are found at once.
    std::array<std::array<double, kCodewords>, 3> by_channel;
    for (std::size_t k = 0; k < kCodewords; ++k) {
        for (unsigned c = 0; c < 3; ++c) {
            by_channel[c][k] =
                k < codewords.size() ? codewords[k][c] : std::numeric_limits<double>::infinity();
        }
    }
    constexpr std::size_t kPiece = 4096;
    std::vector<std::uint8_t> found(colours.size());
    guarded_parallel_for(
        ceil_div(colours.size(), kPiece), threads, [&](std::size_t piece, unsigned) {
            const std::size_t end = std::min(colours.size(), (piece + 1) * kPiece);
            std::array<double, kCodewords> distance;
            for (std::size_t i = piece * kPiece; i < end; ++i) {
                for (std::size_t k = 0; k < kCodewords; ++k) {
                    const double a = by_channel[0][k] - colours[i][0];
                    const double b = by_channel[1][k] - colours[i][1];
                    const double c = by_channel[2][k] - colours[i][2];
                    distance[k] = a * a + b * b + c * c;
                }
                const auto least = std::min_element(distance.begin(), distance.end());
                found[i] = static_cast<std::uint8_t>(least - distance.begin());
            }
        });
    return found;
}

}  // namespace octobrick::codec::detail
