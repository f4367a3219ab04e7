#include "level_fit.h"

#include <algorithm>

#include "simd.h"

namespace octobrick::codec::detail {
namespace {

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

// More rounds or starts gain less than 0.1 dB.
template <bool kInteger>
OCTOBRICK_INLINE Levels find_levels(const float* voxels, std::size_t n, float reach, unsigned width,
                                    bool fitted) {
    const double sum = sum_of(voxels, n);
    if (width == 0 || reach == 0.0f) return mean_level<kInteger>(voxels, n, sum, reach);
    const float most = static_cast<float>((1u << width) - 1);
    const float margin = as_level<kInteger>(even_margin(width, reach), reach);
    Levels best{0, reach, 0};
    // From the ends of the range, which are refined where levels are very few or many, and from
    // half a step inside, where they are few.
    for (int start = 0; start < (fitted && width <= 4 ? 2 : 1); ++start) {
        const int rounds = !fitted ? 0 : start == 1 ? 3 : width <= 2 ? 2 : width <= 4 ? 0 : 1;
        float first = start == 0 ? 0 : margin, last = reach - first;
        for (int round = 0;; ++round) {
            const LevelSums sums = sum_levels<kInteger>(voxels, n, first, last, most);
            if ((start == 0 && round == 0) || sums.squares < best.squares) {
                best = {first, last, sums.squares};
            }
            if (best.squares == 0) return best;
            if (round == rounds) break;
            if (!best_line<kInteger>(sums, n, sum, reach, most, first, last)) break;
        }
    }
    return best;
}

}  // namespace

FindLevels find_levels_for(bool integer, Execution execution) noexcept {
    return integer ? fastest<find_levels<true>, true>(execution)
                   : fastest<find_levels<false>, true>(execution);
}

}  // namespace octobrick::codec::detail
