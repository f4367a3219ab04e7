#include "octobrick/codec/reduce.h"

#include <algorithm>
#include <vector>

#include "parallel.h"
#include "rows.h"
#include "simd.h"

namespace octobrick::codec {
namespace detail {
namespace {

// Sums of four samples, then of eight: exact for integers.
template <class T>
struct SumOf;
template <>
struct SumOf<std::uint8_t> {
    using type = std::uint16_t;  // 8 · 255 + 4
};
template <>
struct SumOf<std::int8_t> {
    using type = std::int16_t;
};
template <>
struct SumOf<std::uint16_t> {
    using type = std::int32_t;
};
template <>
struct SumOf<std::int16_t> {
    using type = std::int32_t;
};
template <>
struct SumOf<float> {
    using type = double;
};
template <class T>
using Sum = typename SumOf<T>::type;

template <class T>
struct ReduceScratch {
    ReduceScratch(const ConstVolume& fine, const Volume& coarse)
        : rows{RowReader<T>(fine), RowReader<T>(fine), RowReader<T>(fine), RowReader<T>(fine)},
          writer(coarse),
          columns(fine.shape.x + 1) {}
    RowReader<T> rows[4];
    RowWriter<T> writer;
    Array<Sum<T>> columns;  // one more than the row: the last column twice, where nx is odd
};

template <class T>
OCTOBRICK_INLINE T mean_of_eight(Sum<T> a, Sum<T> b) {
    if constexpr (std::is_floating_point_v<T>) {
        return static_cast<T>((a + b) / 8);
    } else {
        return static_cast<T>((a + b + 4) >> 3);  // an arithmetic shift: floor, for negatives too
    }
}

template <class T>
OCTOBRICK_INLINE void reduce_row(const T* __restrict r00, const T* __restrict r01,
                                 const T* __restrict r10, const T* __restrict r11, std::size_t nx,
                                 Sum<T>* __restrict columns, T* __restrict to) {
    for (std::size_t x = 0; x < nx; ++x) {
        columns[x] =
            static_cast<Sum<T>>((static_cast<Sum<T>>(r00[x]) + static_cast<Sum<T>>(r01[x])) +
                                (static_cast<Sum<T>>(r10[x]) + static_cast<Sum<T>>(r11[x])));
    }
    columns[nx] = columns[nx - 1];
    for (std::size_t x = 0; x < nx / 2 + nx % 2; ++x) {
        to[x] = mean_of_eight<T>(columns[2 * x], columns[2 * x + 1]);
    }
}

template <class T>
void run_mean2(const ConstVolume& fine, const Volume& coarse, Execution execution) {
    const std::size_t nbytes = fine.shape.z * fine.shape.y * fine.shape.x * sizeof(T);
    const unsigned threads = choose_threads(execution.threads, nbytes, coarse.shape.z);
    const auto reduce = fastest<reduce_row<T>>(execution);

    std::vector<ReduceScratch<T>> scratch;
    scratch.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) {
        scratch.emplace_back(fine, coarse);
    }
    parallel_for(coarse.shape.z, threads, [&](std::size_t z, unsigned worker) {
        ReduceScratch<T>& s = scratch[worker];
        const std::size_t z0 = 2 * z, z1 = std::min(z0 + 1, fine.shape.z - 1);
        for (std::size_t y = 0; y < coarse.shape.y; ++y) {
            const std::size_t y0 = 2 * y, y1 = std::min(y0 + 1, fine.shape.y - 1);
            reduce(s.rows[0].row(z0, y0), s.rows[1].row(z0, y1), s.rows[2].row(z1, y0),
                   s.rows[3].row(z1, y1), fine.shape.x, s.columns.data(), s.writer.row(z, y));
            s.writer.commit(z, y);
        }
    });
}

}  // namespace
}  // namespace detail

bool mean2(const ConstVolume& fine, const Volume& coarse, Execution execution) {
    const bool empty = fine.shape.z == 0 || fine.shape.y == 0 || fine.shape.x == 0;
    if (empty || fine.type != coarse.type || coarse.shape != half_shape(fine.shape)) {
        return false;
    }
    detail::with_sample_type(fine.type,
                             [&]<class T>(T) { detail::run_mean2<T>(fine, coarse, execution); });
    return true;
}

}  // namespace octobrick::codec
