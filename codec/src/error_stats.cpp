#include "octobrick/codec/error_stats.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

#include "rows.h"
#include "simd.h"

namespace octobrick::codec {
namespace detail {
namespace {

// Integers, exactly. 65536 squares of 8-bit differences fit 32 bits (255²·2^16 < 2^32), which are
// summed faster than 64; 16-bit differences need 64, which hold 2^32 of their squares.
template <class T>
class Sums {
  public:
    OCTOBRICK_INLINE void add_row(const T* a, const T* b, std::size_t nx) {
        for (std::size_t x = 0; x < nx; x += kRun) {
            add_run(a + x, b + x, std::min(kRun, nx - x));
        }
    }

    void finish(ErrorStats& stats) const {
        stats.max_abs = max_abs_;
        stats.squares = low_;
        stats.squares_high = high_;
    }

  private:
    static constexpr std::size_t kRun = 65536;
    using RunSum = std::conditional_t<sizeof(T) == 1, std::uint32_t, std::uint64_t>;

    OCTOBRICK_INLINE void add_run(const T* a, const T* b, std::size_t n) {
        std::uint32_t max_abs = 0;
        RunSum squares = 0;
        for (std::size_t i = 0; i < n; ++i) {
            const std::int32_t d = std::int32_t{a[i]} - std::int32_t{b[i]};
            const auto abs = static_cast<std::uint32_t>(d < 0 ? -d : d);
            max_abs = abs > max_abs ? abs : max_abs;
            squares += abs * abs;  // at most 65535² < 2^32
        }
        max_abs_ = std::max(max_abs_, max_abs);
        low_ += squares;
        high_ += low_ < squares;
    }

    std::uint32_t max_abs_ = 0;
    std::uint64_t low_ = 0, high_ = 0;
};

// f32: many sums side by side, added up in one order at the end, so that any number of vector
// lanes gives the same result.
template <>
class Sums<float> {
  public:
    OCTOBRICK_INLINE void add_row(const float* a, const float* b, std::size_t nx) {
        std::size_t x = 0;
        for (; x + kSums <= nx; x += kSums) {
            add_one_each(a + x, b + x);
        }
        if (x < nx) {
            float a_tail[kSums] = {}, b_tail[kSums] = {};  // equal behind the end: nothing added
            std::copy(a + x, a + nx, a_tail);
            std::copy(b + x, b + nx, b_tail);
            add_one_each(a_tail, b_tail);
        }
    }

    void finish(ErrorStats& stats) const {
        for (std::size_t i = 0; i < kSums; ++i) {
            stats.max_abs_f = std::max(stats.max_abs_f, max_abs_[i]);
            stats.squares_f += squares_[i];
        }
        if (std::isnan(stats.squares_f)) {
            stats.max_abs_f = std::numeric_limits<double>::quiet_NaN();
        }
    }

  private:
    // gcc 12 unrolls loops of up to 16 before it would vectorise them.
    static constexpr std::size_t kSums = 32;

    OCTOBRICK_INLINE void add_one_each(const float* a, const float* b) {
        for (std::size_t i = 0; i < kSums; ++i) {
            const double d = std::fabs(static_cast<double>(a[i]) - static_cast<double>(b[i]));
            max_abs_[i] = d > max_abs_[i] ? d : max_abs_[i];  // not for NaN: the sum shows it
            squares_[i] += d * d;
        }
    }

    double max_abs_[kSums] = {}, squares_[kSums] = {};
};

template <class T>
OCTOBRICK_INLINE void add_row(Sums<T>& sums, const T* a, const T* b, std::size_t nx) {
    sums.add_row(a, b, nx);
}

template <class T>
void run_compare(const ConstVolume& a, const ConstVolume& b, ErrorStats& stats,
                 Execution execution) {
    // See simd.h for what was measured.
    const auto add = fastest<add_row<T>, std::is_floating_point_v<T>>(execution);
    const RowReader<T> a_rows(a), b_rows(b);
    Sums<T> sums;
    for (std::size_t z = 0; z < a.shape.z; ++z) {
        for (std::size_t y = 0; y < a.shape.y; ++y) {
            add(sums, a_rows.row(z, y), b_rows.row(z, y), a.shape.x);
        }
    }
    sums.finish(stats);
}

}  // namespace
}  // namespace detail

bool compare(const ConstVolume& a, const ConstVolume& b, ErrorStats& stats, Execution execution) {
    if (a.type != b.type || a.shape != b.shape) {
        return false;
    }
    stats = {};
    stats.count = std::uint64_t{a.shape.z} * a.shape.y * a.shape.x;
    if (stats.count > 0) {
        detail::with_sample_type(
            a.type, [&]<class T>(T) { detail::run_compare<T>(a, b, stats, execution); });
    }
    return true;
}

}  // namespace octobrick::codec
