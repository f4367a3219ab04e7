#include "width_choice.h"

#include <algorithm>

#include "s3dc_variable_format.h"

namespace octobrick::codec::detail {

namespace {

std::uint32_t units_at(std::size_t width, std::uint32_t raw_units) {
    return width == kRaw ? raw_units : static_cast<std::uint32_t>(width);
}

// All steps steeper than `slope` are taken, and those as steep while `left` units last.
struct SlopeSplit {
    double slope;
    std::uint64_t left;
};

// The slope at which the budget runs out. Each round halves the steps in question, or better.
SlopeSplit find_split(std::vector<HullStep>& steps, std::uint64_t units) {
    std::uint64_t left = units;
    auto begin = steps.begin(), end = steps.end();
    while (begin != end) {
        const auto middle = begin + (end - begin) / 2;
        std::nth_element(begin, middle, end,
                         [](const HullStep& a, const HullStep& b) { return a.slope > b.slope; });
        const double pivot = middle->slope;
        // [begin, above) is steeper than the pivot, [above, level) as steep.
        const auto above =
            std::partition(begin, end, [&](const HullStep& s) { return s.slope > pivot; });
        const auto level =
            std::partition(above, end, [&](const HullStep& s) { return s.slope == pivot; });
        std::uint64_t steeper = 0, equal = 0;
        for (auto step = begin; step != above; ++step) steeper += step->units;
        for (auto step = above; step != level; ++step) equal += step->units;
        if (steeper > left) {
            end = above;
            continue;
        }
        left -= steeper;
        if (equal > left) return {pivot, left};
        left -= equal;
        begin = level;
    }
    // Where an end was cut off, what lay before it did not fit, and the loop has returned.
    return {-1, left};  // all fit
}

}  // namespace

std::size_t hull_of(const BlockCurve& curve, std::uint32_t raw_units,
                    std::array<HullStep, kWidths>& steps) {
    std::array<std::uint8_t, kWidths> hull;  // widths on it
    std::size_t n = 0;
    const auto slope = [&](std::size_t from, std::size_t to) {
        return (curve.squares[from] - curve.squares[to]) /
               (units_at(to, raw_units) - units_at(from, raw_units));
    };
    for (std::uint8_t width = 0; width < kWidths; ++width) {
        if (n > 0 && !(curve.squares[width] < curve.squares[hull[n - 1]])) continue;
        while (n > 1 && slope(hull[n - 2], hull[n - 1]) <= slope(hull[n - 1], width)) --n;
        hull[n++] = width;
    }
    for (std::size_t i = 1; i < n; ++i) {
        steps[i - 1] = {units_at(hull[i], raw_units) - units_at(hull[i - 1], raw_units),
                        slope(hull[i - 1], hull[i]), hull[i]};
    }
    return n - 1;
}

void choose_widths(std::span<const BlockCurve> curves, std::uint32_t raw_units, std::uint64_t units,
                   std::span<std::uint8_t> widths) {
    std::array<HullStep, kWidths> hull;
    std::vector<HullStep> steps;
    for (const BlockCurve& curve : curves) {
        const std::size_t n = hull_of(curve, raw_units, hull);
        steps.insert(steps.end(), hull.begin(), hull.begin() + static_cast<std::ptrdiff_t>(n));
    }
    SlopeSplit split = find_split(steps, units);
    bool full = false;
    for (std::size_t block = 0; block < curves.size(); ++block) {
        const std::size_t n = hull_of(curves[block], raw_units, hull);
        widths[block] = 0;
        for (std::size_t i = 0; i < n && hull[i].slope >= split.slope; ++i) {
            if (hull[i].slope == split.slope) {
                full = full || hull[i].units > split.left;
                if (full) break;
                split.left -= hull[i].units;
            }
            widths[block] = hull[i].width;
        }
    }
}

void choose_widths_by_slope(std::span<const BlockCurve> curves, std::uint32_t raw_units,
                            double slope, std::span<std::uint8_t> widths) {
    std::array<HullStep, kWidths> hull;
    for (std::size_t block = 0; block < curves.size(); ++block) {
        const std::size_t n = hull_of(curves[block], raw_units, hull);
        widths[block] = 0;
        for (std::size_t i = 0; i < n && hull[i].slope >= slope; ++i) {
            widths[block] = hull[i].width;
        }
    }
}

}  // namespace octobrick::codec::detail
