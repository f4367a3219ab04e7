// From samples to indices and back: the arithmetic of S3Dc, in forms that processors can do
// eight to thirty-two at a time. The formats' own formulas, which tests compare with:
//
//   integers   R = max − min,  L = 2^bits − 1,  d = v − min
//              index   = (2dL + R) div 2R,  0 where R = 0
//              decoded = min + (2R·index + L) div 2L
//   f32        index   = floor((v − min) / (max − min) · L + 0.5) in double, 0 where max = min
//              decoded = max where index = L, else
//                        float(min + (max − min)·index / L), clamped to [min, max]
//
// In both integer formulas the divisor is even, and floor(a / 2b) = floor(floor(a / 2) / b), so
//
//   index   = (dL + (R div 2)) div R             decoded = min + (R·index + (L div 2)) div L
//
// Every block's coefficients are spread over its columns (arrays along x), which makes a row of
// voxels one loop whatever the block size is.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "rows.h"
#include "simd.h"

namespace octobrick::codec::detail {

// ---- Encoding ------------------------------------------------------------------------------

// 8-bit samples, in 16-bit integers that wrap.
//
// With n = dL + (R div 2), the quotient n div R is (n·m) >> k for a 16-bit reciprocal m ≈ 2^k/R.
// Let 2^j < R <= 2^(j+1) and k = 16 + j. One of the two ways of rounding is exact for all n < 2^16:
//   up    m = ceil(2^k/R), e = mR − 2^k <= 2^j:
//         nm/2^k = n/R + (n·e/2^k)/R, and n·e < 2^16·2^j = 2^k, so less than 1/R is added
//   down  m = floor(2^k/R), e = 2^k − mR <= 2^j, used as ((n + 1)·m) >> k:
//         its exact value is (n + 1)(1 − e/2^k)/R, in [n/R, (n + 1)/R), as 0 < (n + 1)·e/2^k <= 1
// and since the two e add up to R <= 2^(j+1), one of them is <= 2^j. R = 1 is the case j = −1.
//
// To shift by a constant, n is scaled by 2^(7−j): index = (n·2^(7−j)·m) >> 23, which is the high
// half of a 16-bit product, shifted by 7. Both factors fit 16 bits: m is at most 2^15 for R = 1,
// else ceil(2^k/(2^j + 1)); and n·2^(7−j) <= R(L + 1/2)·2^(7−j) <= 255.5·2^8 = 65408. "Down" adds
// up to 2^6 to that, since it is never taken for a power of two (e = 0), hence not for R < 3.
//
// d·scale + offset = v·scale + (offset − min·scale) modulo 2^16 saves the subtraction of min.
class Quantiser8 {
  public:
    explicit Quantiser8(std::size_t nx) : scale_(nx), offset_(nx), reciprocal_(nx) {}

    template <class T>
    void set(std::size_t begin, std::size_t end, T min, T max, unsigned levels) {
        const unsigned range = static_cast<unsigned>(max - min);
        unsigned scale = 0, offset = 0, reciprocal = 0;
        if (range > 0) {
            const int j = static_cast<int>(std::bit_width(range - 1)) - 1;
            const unsigned power = 1u << (16 + j);
            const unsigned shift = static_cast<unsigned>(7 - j);
            reciprocal = (power + range - 1) / range;
            unsigned half = range / 2;
            if (2 * (reciprocal * range - power) > 1u << (j + 1)) {  // e > 2^j: round down
                --reciprocal;
                ++half;
            }
            scale = levels << shift;
            offset = (half << shift) - static_cast<unsigned>(min) * scale;
        }
        for (std::size_t x = begin; x < end; ++x) {
            scale_[x] = static_cast<std::uint16_t>(scale);
            offset_[x] = static_cast<std::uint16_t>(offset);
            reciprocal_[x] = static_cast<std::uint16_t>(reciprocal);
        }
    }

    template <class T>
    OCTOBRICK_INLINE void quantise(const T* row, std::size_t x, std::size_t n, unsigned,
                                   std::uint8_t* indices) const {
        const std::uint16_t* scale = scale_.data() + x;
        const std::uint16_t* offset = offset_.data() + x;
        const std::uint16_t* reciprocal = reciprocal_.data() + x;
        for (std::size_t i = 0; i < n; ++i) {
            const auto scaled = static_cast<std::uint16_t>(
                static_cast<unsigned>(row[x + i]) * scale[i] + offset[i]);
            const auto high =
                static_cast<std::uint16_t>((std::uint32_t{scaled} * reciprocal[i]) >> 16);
            indices[i] = static_cast<std::uint8_t>(high >> 7);
        }
    }

  private:
    Array<std::uint16_t> scale_, offset_, reciprocal_;
};

// 16-bit samples, in float, whose rounding changes a value by at most u = 2^-24 of itself.
//
// bits <= 6: t = dL + (R div 2) + 1/2 and its terms, v·L and (R div 2) + 1/2 − min·L, are multiples
// of 1/2 below 2^22, hence exact. index = trunc(t·(1/R)), rounded twice, is off by at most
// (t/R)(2u + u²) before truncation, while t/R, a whole number and a half over R, is at least
// 1/(2R) away from every integer. It suffices that t(2u + u²) < 1/2: t <= 63.5·65535 gives 0.497.
//
// bits 7, 8: the 1/2 no longer fits, n = dL + (R div 2) < 2^24 does. q = trunc(n·(1/R)) is off by
// at most 1, as n/R < 256 and its error below 2^-14; the remainder n − qR tells, and is exact:
// where q is 1 too large, qR exceeds n by less than R·2^-14 <= 4, hence is below 2^24 as well.
class Quantiser16 {
  public:
    explicit Quantiser16(std::size_t nx) : offset_(nx), range_(nx), reciprocal_(nx) {}

    template <class T>
    void set(std::size_t begin, std::size_t end, T min, T max, unsigned levels) {
        const int range = max - min;
        const float half = levels < 127 ? 0.5f : 0.0f;
        const float offset = static_cast<float>(range / 2 - min * static_cast<int>(levels)) + half;
        const float reciprocal = range > 0 ? 1.0f / static_cast<float>(range) : 0.0f;
        for (std::size_t x = begin; x < end; ++x) {
            offset_[x] = offset;
            range_[x] = static_cast<float>(range > 0 ? range : 1);
            reciprocal_[x] = reciprocal;
        }
    }

    template <class T>
    OCTOBRICK_INLINE void quantise(const T* row, std::size_t x, std::size_t n, unsigned levels,
                                   std::uint8_t* indices) const {
        const float* offset = offset_.data() + x;
        const float* range = range_.data() + x;
        const float* reciprocal = reciprocal_.data() + x;
        const float scale = static_cast<float>(levels);
        if (levels < 127) {
            for (std::size_t i = 0; i < n; ++i) {
                const float t = static_cast<float>(row[x + i]) * scale + offset[i];
                indices[i] = static_cast<std::uint8_t>(static_cast<int>(t * reciprocal[i]));
            }
            return;
        }
        for (std::size_t i = 0; i < n; ++i) {
            const float t = static_cast<float>(row[x + i]) * scale + offset[i];
            const int q = static_cast<int>(t * reciprocal[i]);
            const float rest = t - static_cast<float>(q) * range[i];
            indices[i] = static_cast<std::uint8_t>(q + (rest >= range[i]) - (rest < 0.0f));
        }
    }

  private:
    Array<float> offset_, range_, reciprocal_;
};

// f32, in double, operation by operation as the format says: a division, not a reciprocal.
class QuantiserFloat {
  public:
    explicit QuantiserFloat(std::size_t nx) : min_(nx), range_(nx) {}

    void set(std::size_t begin, std::size_t end, float min, float max, unsigned) {
        const double range = static_cast<double>(max) - static_cast<double>(min);
        for (std::size_t x = begin; x < end; ++x) {
            min_[x] = static_cast<double>(min);
            range_[x] = range > 0 ? range : 1.0;  // 0/1 is index 0, 0/0 would be none
        }
    }

    OCTOBRICK_INLINE void quantise(const float* row, std::size_t x, std::size_t n, unsigned levels,
                                   std::uint8_t* indices) const {
        const double* min = min_.data() + x;
        const double* range = range_.data() + x;
        const double scale = levels;
        for (std::size_t i = 0; i < n; ++i) {
            const double t = (static_cast<double>(row[x + i]) - min[i]) / range[i] * scale + 0.5;
            indices[i] = static_cast<std::uint8_t>(static_cast<int>(t));
        }
    }

  private:
    Array<double> min_, range_;
};

template <class T>
using QuantiserFor =
    std::conditional_t<sizeof(T) == 1, Quantiser8,
                       std::conditional_t<sizeof(T) == 2, Quantiser16, QuantiserFloat>>;

// ---- Decoding ------------------------------------------------------------------------------
//
// Two's complement wraps, so signed samples decode as unsigned ones of the same width.

// 8-bit samples: R·index + (L div 2) <= 255·255 + 127 < 2^16.
template <unsigned B>
OCTOBRICK_INLINE std::uint8_t decoded8(std::uint16_t min, std::uint16_t range, std::uint8_t index) {
    constexpr std::uint16_t kLevels = (1u << B) - 1;
    const auto scaled = static_cast<std::uint16_t>(index * range + kLevels / 2);
    return static_cast<std::uint8_t>(min + scaled / kLevels);
}

template <unsigned B>
class Dequantiser8 {
  public:
    explicit Dequantiser8(std::size_t nx) : min_(nx), range_(nx) {}

    void set(std::size_t begin, std::size_t end, std::uint8_t min, std::uint8_t max) {
        for (std::size_t x = begin; x < end; ++x) {
            min_[x] = min;
            range_[x] = static_cast<std::uint8_t>(max - min);
        }
    }

    OCTOBRICK_INLINE void dequantise(const std::uint8_t* indices, std::size_t x, std::size_t n,
                                     std::uint8_t* row) const {
        const std::uint16_t* min = min_.data() + x;
        const std::uint16_t* range = range_.data() + x;
        for (std::size_t i = 0; i < n; ++i) {
            row[x + i] = decoded8<B>(min[i], range[i], indices[i]);
        }
    }

  private:
    Array<std::uint16_t> min_, range_;
};

// 16-bit samples, in 16-bit integers too: with R = L·a + c, c < L,
//   (R·index + (L div 2)) div L = a·index + (c·index + (L div 2)) div L,
// where c·index + (L div 2) <= 254·255 + 127 < 2^16.
template <unsigned B>
OCTOBRICK_INLINE std::uint16_t decoded16(std::uint16_t min, std::uint16_t whole, std::uint16_t rest,
                                         std::uint8_t index) {
    constexpr std::uint16_t kLevels = (1u << B) - 1;
    const auto scaled = static_cast<std::uint16_t>(index * rest + kLevels / 2);
    return static_cast<std::uint16_t>(min + static_cast<unsigned>(index) * whole +
                                      scaled / kLevels);
}

template <unsigned B>
class Dequantiser16 {
  public:
    explicit Dequantiser16(std::size_t nx) : min_(nx), whole_(nx), rest_(nx) {}

    void set(std::size_t begin, std::size_t end, std::uint16_t min, std::uint16_t max) {
        const auto range = static_cast<std::uint16_t>(max - min);
        for (std::size_t x = begin; x < end; ++x) {
            min_[x] = min;
            whole_[x] = range / kLevels;
            rest_[x] = range % kLevels;
        }
    }

    OCTOBRICK_INLINE void dequantise(const std::uint8_t* indices, std::size_t x, std::size_t n,
                                     std::uint16_t* row) const {
        const std::uint16_t* min = min_.data() + x;
        const std::uint16_t* whole = whole_.data() + x;
        const std::uint16_t* rest = rest_.data() + x;
        for (std::size_t i = 0; i < n; ++i) {
            row[x + i] = decoded16<B>(min[i], whole[i], rest[i], indices[i]);
        }
    }

  private:
    static constexpr std::uint16_t kLevels = (1u << B) - 1;
    Array<std::uint16_t> min_, whole_, rest_;
};

// f32. Where max − min is rounded, min + (max − min) is not max: −1e30 + (−1e-30 − −1e30) is 0. So
// values are clamped, and the last index is max by definition.
template <unsigned B>
OCTOBRICK_INLINE float decoded_float(float min, float max, double range, int index) {
    constexpr int kLevels = (1 << B) - 1;
    float value = static_cast<float>(static_cast<double>(min) + range * index / kLevels);
    value = value < min ? min : value;
    value = value > max ? max : value;
    return index == kLevels ? max : value;
}

template <unsigned B>
class DequantiserFloat {
  public:
    explicit DequantiserFloat(std::size_t nx) : min_(nx), max_(nx), range_(nx) {}

    void set(std::size_t begin, std::size_t end, float min, float max) {
        const double range = static_cast<double>(max) - static_cast<double>(min);
        for (std::size_t x = begin; x < end; ++x) {
            min_[x] = min;
            max_[x] = max;
            range_[x] = range;
        }
    }

    OCTOBRICK_INLINE void dequantise(const std::uint8_t* indices, std::size_t x, std::size_t n,
                                     float* row) const {
        const float* min = min_.data() + x;
        const float* max = max_.data() + x;
        const double* range = range_.data() + x;
        for (std::size_t i = 0; i < n; ++i) {
            row[x + i] = decoded_float<B>(min[i], max[i], range[i], indices[i]);
        }
    }

  private:
    Array<float> min_, max_;
    Array<double> range_;
};

template <class T, unsigned B>
using DequantiserFor =
    std::conditional_t<sizeof(T) == 1, Dequantiser8<B>,
                       std::conditional_t<sizeof(T) == 2, Dequantiser16<B>, DequantiserFloat<B>>>;

}  // namespace octobrick::codec::detail
