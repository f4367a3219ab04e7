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

inline constexpr std::size_t kLanes = 16;
// Float sums of more voxels than this are carried on in double.
inline constexpr std::size_t kRunOfVoxels = 512;

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
        for (std::size_t lane = 0; lane < kLanes; ++lane) {
            sums.squares += static_cast<double>(squares[lane]);
            sums.k += static_cast<double>(k[lane]);
            sums.kk += static_cast<double>(kk[lane]);
            sums.kv += static_cast<double>(kv[lane]);
        }
    }
    return sums;
}

inline double sum_of(const float* voxels, std::size_t n) {
    double sum = 0;
    for (std::size_t i = 0; i < n; ++i) sum += static_cast<double>(voxels[i]);
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

// Alternates indices and the best line through them, from the given levels on; the best is kept.
template <bool kInteger>
OCTOBRICK_INLINE void refine_levels(const float* voxels, std::size_t n, double sum, float reach,
                                    float most, float first, float last, int rounds, Levels& best) {
    for (int round = 0;; ++round) {
        const LevelSums sums = sum_levels<kInteger>(voxels, n, first, last, most);
        if (sums.squares < best.squares) best = {first, last, sums.squares};
        const double determinant = static_cast<double>(n) * sums.kk - sums.k * sums.k;
        if (round == rounds || determinant <= 0) return;
        const double step = (static_cast<double>(n) * sums.kv - sums.k * sum) / determinant;
        const double start = (sum - step * sums.k) / static_cast<double>(n);
        const float next_first = as_level<kInteger>(start, reach);
        const float next_last = as_level<kInteger>(start + step * static_cast<double>(most), reach);
        if (next_last <= next_first || (next_first == first && next_last == last)) return;
        first = next_first;
        last = next_last;
    }
}

// How far inside of a block's range the outer of 2^width levels lie where its voxels are spread
// evenly: half a step on each side.
inline float even_margin(unsigned width, float reach) {
    return reach / static_cast<float>(2u << width);
}

// The levels of a block for `width` bits: least and greatest voxel, or fitted from two starts
// (few rounds suffice: measured on eleven volumes, more gain less than 0.05 dB).
template <bool kInteger>
OCTOBRICK_INLINE Levels find_levels(const float* voxels, std::size_t n, double sum, float reach,
                                    unsigned width, bool fitted) {
    if (width == 0 || reach == 0.0f) return mean_level<kInteger>(voxels, n, sum, reach);
    const float most = static_cast<float>((1u << width) - 1);
    Levels best{0, reach, sum_levels<kInteger>(voxels, n, 0, reach, most).squares};
    if (!fitted || best.squares == 0) return best;
    const float margin = even_margin(width, reach);
    const int rounds = width <= 4 ? 3 : 1;
    refine_levels<kInteger>(voxels, n, sum, reach, most, as_level<kInteger>(margin, reach),
                            as_level<kInteger>(reach - margin, reach), rounds, best);
    if (width <= 4) {
        refine_levels<kInteger>(voxels, n, sum, reach, most, 0, reach, rounds, best);
    }
    return best;
}

}  // namespace octobrick::codec::detail
