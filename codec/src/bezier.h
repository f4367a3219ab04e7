// Rational Bézier curves through the samples of two neighbouring blocks, many lines side by side.
//
//   f(s) = sum_i B_i(t) w_i I_i / sum_i B_i(t) w_i,   t = s / (n - 1),
//   B_i(t) = (n - 1 over i) t^i (1 - t)^(n - 1 - i)    for the n samples I_i of both blocks
#pragma once

#include <cstddef>
#include <vector>

#include "rows.h"

namespace octobrick::codec::detail {

// Lines that are evaluated together: as many sums as registers hold.
inline constexpr std::size_t kBezierLanes = 16;

// Below this, exp(-x) is a double that is not denormal, with room for sums of millions.
inline constexpr double kSafeDoubleLog = 680;

// Samples i and lines l of two blocks lie at i * stride + l * line_stride.
struct BezierSamples {
    const float* values;
    const float* weights;  // or magnitudes, where weights are made in logarithms
    std::size_t stride, line_stride, lanes;
};

// What one thread works in.
class BezierPanel {
  public:
    explicit BezierPanel(std::size_t samples)
        : products(samples * kBezierLanes),
          weights(samples * kBezierLanes),
          results(samples * kBezierLanes) {}
    // The filtered value of the s-th sample that is filtered.
    double result(std::size_t s, std::size_t lane) const {
        return results[s * kBezierLanes + lane];
    }

    Array<double> products, weights, results;
    alignas(64) double origin[kBezierLanes] = {};  // of the lines' values: their first sample
};

class Bezier {
  public:
    // For two blocks of so many samples, each at least 1.
    Bezier(std::size_t before, std::size_t after);

    // The samples that are filtered, [first, last): half of each block, rounded down.
    std::size_t first() const { return first_; }
    std::size_t last() const { return last_; }

    // The logarithm of the least of all B_i(t).
    double least_log() const { return least_log_; }

    // Sums products. No product may underflow to nothing where its sum does: see kSafeDoubleLog.
    void evaluate(const BezierSamples& samples, BezierPanel& panel, bool simd) const;

    // The same for weights exp(-strength * magnitude) of any size, at one exp per product.
    void evaluate_logarithmic(const BezierSamples& samples, double strength,
                              BezierPanel& panel) const;

  private:
    std::size_t count_, first_, last_;
    double least_log_ = 0;
    std::vector<double> logs_, basis_;  // [s - first][i]
};

}  // namespace octobrick::codec::detail
