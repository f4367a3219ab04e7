#include "bezier.h"

#include <algorithm>
#include <cmath>

#include "simd.h"

namespace octobrick::codec::detail {

Bezier::Bezier(std::size_t before, std::size_t after)
    : count_(before + after),
      first_(before - before / 2),
      last_(before + after / 2),
      logs_((last_ - first_) * count_),
      basis_(logs_.size()) {
    const double degree = static_cast<double>(count_ - 1);
    for (std::size_t s = first_; s < last_; ++s) {
        // Never 0 or 1: the outer half of a block is at least one sample.
        const double t = static_cast<double>(s) / degree;
        double* logs = &logs_[(s - first_) * count_];
        double log_binomial = 0;
        for (std::size_t i = 0; i < count_; ++i) {
            const double k = static_cast<double>(i);
            if (i > 0) log_binomial += std::log((degree - k + 1) / k);
            logs[i] = log_binomial + k * std::log(t) + (degree - k) * std::log1p(-t);
            least_log_ = std::min(least_log_, logs[i]);
        }
    }
    std::transform(logs_.begin(), logs_.end(), basis_.begin(),
                   [](double log) { return std::exp(log); });
}

namespace {

// Values relative to each line's first sample: so a constant line stays what it is, exactly.
void load(const BezierSamples& samples, std::size_t count, BezierPanel& panel) {
    for (std::size_t l = 0; l < kBezierLanes; ++l) {
        panel.origin[l] = l < samples.lanes ? samples.values[l * samples.line_stride] : 0;
    }
    for (std::size_t i = 0; i < count; ++i) {
        const std::size_t row = i * kBezierLanes;
        for (std::size_t l = 0; l < samples.lanes; ++l) {
            const std::size_t at = i * samples.stride + l * samples.line_stride;
            const double weight = samples.weights[at];
            panel.weights[row + l] = weight;
            panel.products[row + l] = weight * (samples.values[at] - panel.origin[l]);
        }
        for (std::size_t l = samples.lanes; l < kBezierLanes; ++l) {
            panel.weights[row + l] = 1;
            panel.products[row + l] = 0;
        }
    }
}

OCTOBRICK_INLINE void sum_rows(const double* __restrict basis, std::size_t rows, std::size_t count,
                               const double* __restrict products, const double* __restrict weights,
                               const double* __restrict origin, double* __restrict results) {
    for (std::size_t s = 0; s < rows; ++s) {
        double above[kBezierLanes] = {}, below[kBezierLanes] = {};
        for (std::size_t i = 0; i < count; ++i) {
            const double b = basis[s * count + i];
            for (std::size_t l = 0; l < kBezierLanes; ++l) {
                above[l] += b * products[i * kBezierLanes + l];
                below[l] += b * weights[i * kBezierLanes + l];
            }
        }
        for (std::size_t l = 0; l < kBezierLanes; ++l) {
            results[s * kBezierLanes + l] = origin[l] + above[l] / below[l];
        }
    }
}

}  // namespace

void Bezier::evaluate(const BezierSamples& samples, BezierPanel& panel, bool simd) const {
    load(samples, count_, panel);
    const auto sum = fastest<sum_rows>({.simd = simd});
    sum(basis_.data(), last_ - first_, count_, panel.products.data(), panel.weights.data(),
        panel.origin, panel.results.data());
}

void Bezier::evaluate_logarithmic(const BezierSamples& samples, double strength,
                                  BezierPanel& panel) const {
    for (std::size_t l = 0; l < samples.lanes; ++l) {
        const float* values = samples.values + l * samples.line_stride;
        const float* magnitudes = samples.weights + l * samples.line_stride;
        // Relative to the heaviest sample, whose own exponent is then 0 · strength, never ∞ − ∞.
        float heaviest = magnitudes[0];
        for (std::size_t i = 1; i < count_; ++i) {
            const float m = magnitudes[i * samples.stride];
            heaviest = strength < 0 ? std::max(heaviest, m) : std::min(heaviest, m);
        }
        double* exponents = panel.weights.data();
        for (std::size_t s = 0; s < last_ - first_; ++s) {
            double greatest = -INFINITY;
            for (std::size_t i = 0; i < count_; ++i) {
                const double m = double{magnitudes[i * samples.stride]} - heaviest;
                exponents[i] = logs_[s * count_ + i] - strength * m;
                greatest = std::max(greatest, exponents[i]);
            }
            double above = 0, below = 0;
            for (std::size_t i = 0; i < count_; ++i) {
                const double weight = std::exp(exponents[i] - greatest);
                above += weight * (double{values[i * samples.stride]} - values[0]);
                below += weight;
            }
            panel.results[s * kBezierLanes + l] = values[0] + above / below;
        }
    }
}

}  // namespace octobrick::codec::detail
