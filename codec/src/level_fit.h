// Where to put the levels of a block: end points, and the squared error that they leave.
//
// Works on a block's voxels less their minimum as floats in [0, reach]: integers are themselves,
// and exact; floats are scaled to [0, 65535]. What comes out is a choice of the encoder, so float
// sums do; they are kept in a fixed number of lanes, so that every instruction set adds alike.
#pragma once

#include <algorithm>
#include <cstddef>

#include "simd.h"

namespace octobrick::codec::detail {

// With more bits than this, levels lie so close that fitting them gains nothing.
inline constexpr unsigned kMostFitted = 6;

// First and last level of a block, and the sum of squared errors with them.
struct Levels {
    float first = 0, last = 0;
    double squares = 0;
};

// Sums over voxels v with indices k: what a least-squares line through (k, v) needs.
struct LevelSums {
    double squares = 0;  // of v − decoded
    double k = 0, kk = 0, kv = 0;
};

// gcc 12 unrolls loops of up to 16 before it would vectorise them.
inline constexpr std::size_t kLanes = 32;
// Float sums of more voxels than this are carried on in double.
inline constexpr std::size_t kRunOfVoxels = 512;

// The sum of all lanes, halves by halves. The lanes are lost.
OCTOBRICK_INLINE double fold(float (&lanes)[kLanes]) {
    for (std::size_t half = kLanes / 2; half > 0; half /= 2) {
        for (std::size_t lane = 0; lane < half; ++lane) lanes[lane] += lanes[lane + half];
    }
    return static_cast<double>(lanes[0]);
}

template <bool kInteger>
OCTOBRICK_INLINE void add_voxel(float v, float first, float step, float steps_per_value, float most,
                                float& squares, float& sum_k, float& sum_kk, float& sum_kv) {
    float t = (v - first) * steps_per_value + 0.5f;
    t = t > 0.0f ? t : 0.0f;
    t = t < most ? t : most;
    const float k = static_cast<float>(static_cast<int>(t));
    float decoded = first + k * step;
    if constexpr (kInteger) decoded = static_cast<float>(static_cast<int>(decoded + 0.5f));
    const float off = v - decoded;
    squares += off * off;
    sum_k += k;
    sum_kk += k * k;
    sum_kv += k * v;
}

// One pass over a block with given levels. `most` is the last index.
template <bool kInteger>
OCTOBRICK_INLINE LevelSums sum_levels(const float* voxels, std::size_t n, float first, float last,
                                      float most) {
    const float step = (last - first) / most;
    const float steps_per_value = step > 0.0f ? 1.0f / step : 0.0f;
    LevelSums sums;
    for (std::size_t begin = 0; begin < n; begin += kRunOfVoxels) {
        const std::size_t end = std::min(n, begin + kRunOfVoxels);
        float squares[kLanes] = {}, k[kLanes] = {}, kk[kLanes] = {}, kv[kLanes] = {};
        std::size_t i = begin;
        for (; i + kLanes <= end; i += kLanes) {
            for (std::size_t lane = 0; lane < kLanes; ++lane) {
                add_voxel<kInteger>(voxels[i + lane], first, step, steps_per_value, most,
                                    squares[lane], k[lane], kk[lane], kv[lane]);
            }
        }
        for (std::size_t lane = 0; i + lane < end; ++lane) {
            add_voxel<kInteger>(voxels[i + lane], first, step, steps_per_value, most, squares[lane],
                                k[lane], kk[lane], kv[lane]);
        }
        sums.squares += fold(squares);
        sums.k += fold(k);
        sums.kk += fold(kk);
        sums.kv += fold(kv);
    }
    return sums;
}

OCTOBRICK_INLINE double sum_of(const float* voxels, std::size_t n) {
    double sum = 0;
    for (std::size_t begin = 0; begin < n; begin += kRunOfVoxels) {
        const std::size_t end = std::min(n, begin + kRunOfVoxels);
        float lanes[kLanes] = {};
        std::size_t i = begin;
        for (; i + kLanes <= end; i += kLanes) {
            for (std::size_t lane = 0; lane < kLanes; ++lane) lanes[lane] += voxels[i + lane];
        }
        for (std::size_t lane = 0; i + lane < end; ++lane) lanes[lane] += voxels[i + lane];
        sum += fold(lanes);
    }
    return sum;
}

template <bool kInteger>
float as_level(double value, float reach) {
    const float level = std::clamp(static_cast<float>(value), 0.0f, reach);
    return kInteger ? static_cast<float>(static_cast<int>(level + 0.5f)) : level;
}

// The one level of a block without indices: the mean.
template <bool kInteger>
OCTOBRICK_INLINE Levels mean_level(const float* voxels, std::size_t n, double sum, float reach) {
    Levels levels;
    levels.first = levels.last = as_level<kInteger>(sum / static_cast<double>(n), reach);
    levels.squares = sum_levels<kInteger>(voxels, n, levels.first, levels.last, 1.0f).squares;
    return levels;
}

// The line through (index, voxel) of least squares, as levels. False where all indices are alike.
template <bool kInteger>
bool best_line(const LevelSums& sums, std::size_t n, double sum, float reach, float most,
               float& first, float& last) {
    const double count = static_cast<double>(n);
    const double determinant = count * sums.kk - sums.k * sums.k;
    if (determinant <= 0) return false;
    const double step = (count * sums.kv - sums.k * sum) / determinant;
    const double start = (sum - step * sums.k) / count;
    first = as_level<kInteger>(start, reach);
    last = as_level<kInteger>(start + step * static_cast<double>(most), reach);
    return last > first;
}

// Alternates indices and the best line through them, from levels and their sums on; keeps the best.
template <bool kInteger>
OCTOBRICK_INLINE void refine_levels(const float* voxels, std::size_t n, double sum, float reach,
                                    float most, LevelSums sums, int rounds, Levels& best) {
    for (int round = 0; round < rounds; ++round) {
        float first, last;
        if (!best_line<kInteger>(sums, n, sum, reach, most, first, last)) return;
        if (first == best.first && last == best.last) return;
        sums = sum_levels<kInteger>(voxels, n, first, last, most);
        if (sums.squares < best.squares) best = {first, last, sums.squares};
    }
}

// How far inside of a block's range the outer of 2^width levels lie where its voxels are spread
// evenly: half a step on each side.
inline float even_margin(unsigned width, float reach) {
    return reach / static_cast<float>(2u << width);
}

// The levels of a block for `width` bits: least and greatest voxel, or fitted from there and, where
// levels are few, from half a step inside. More rounds or starts gain less than 0.1 dB.
template <bool kInteger>
OCTOBRICK_INLINE Levels find_levels(const float* voxels, std::size_t n, double sum, float reach,
                                    unsigned width, bool fitted) {
    if (width == 0 || reach == 0.0f) return mean_level<kInteger>(voxels, n, sum, reach);
    const float most = static_cast<float>((1u << width) - 1);
    const LevelSums ends = sum_levels<kInteger>(voxels, n, 0, reach, most);
    Levels best{0, reach, ends.squares};
    if (!fitted || best.squares == 0) return best;
    if (width <= 2 || width > 4) {
        refine_levels<kInteger>(voxels, n, sum, reach, most, ends, width <= 2 ? 2 : 1, best);
    }
    if (width > 4) return best;
    const float first = as_level<kInteger>(even_margin(width, reach), reach);
    const float last = reach - first;
    const LevelSums inside = sum_levels<kInteger>(voxels, n, first, last, most);
    if (inside.squares < best.squares) best = {first, last, inside.squares};
    refine_levels<kInteger>(voxels, n, sum, reach, most, inside, 3, best);
    return best;
}

// The squared error with levels at least and greatest voxel, for a width whose steps are so fine
// that voxels lie evenly within one: from the error at a narrower width.
template <bool kInteger>
double fine_squares(double squares, unsigned width, unsigned wider, float reach) {
    const auto variance = [reach](unsigned w) {  // of a step, times 12
        const double step = static_cast<double>(reach) / ((1u << w) - 1);
        return step * step - (kInteger ? 1 : 0);  // between whole numbers, decoded to whole numbers
    };
    return squares * variance(wider) / variance(width);
}

}  // namespace octobrick::codec::detail
