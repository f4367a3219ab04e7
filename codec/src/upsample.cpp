#include "octobrick/codec/upsample.h"

#include <algorithm>
#include <vector>

#include "octobrick/codec/reduce.h"
#include "parallel.h"
#include "rows.h"
#include "simd.h"

namespace octobrick::codec {
namespace detail {
namespace {

// Weighted sums: below 64 · 65536 for integers.
template <class T>
using Sum = std::conditional_t<std::is_floating_point_v<T>, double, std::int32_t>;

template <class T>
struct UpsampleScratch {
    UpsampleScratch(const ConstVolume& coarse, const Volume& fine)
        : rows{RowReader<T>(coarse), RowReader<T>(coarse), RowReader<T>(coarse),
               RowReader<T>(coarse)},
          writer(fine),
          columns(coarse.shape.x + 2) {}
    RowReader<T> rows[4];
    RowWriter<T> writer;
    Array<Sum<T>> columns;  // one more on each side of the row
};

// The coarse voxel that a fine one lies in, and the other one that it is near to.
struct Pair {
    std::size_t in, near;
};
Pair coarse_pair(std::size_t fine, std::size_t coarse_extent) {
    const std::size_t in = fine / 2;
    if (fine % 2 == 0) return {in, in > 0 ? in - 1 : 0};
    return {in, std::min(in + 1, coarse_extent - 1)};
}

template <class T>
OCTOBRICK_INLINE T from_sum(Sum<T> sum) {
    if constexpr (std::is_floating_point_v<T>) {
        return static_cast<T>(sum / 64);
    } else {
        return static_cast<T>((sum + 32) >> 6);  // an arithmetic shift: floor, for negatives too
    }
}

// rZY: the row that z lies in or is near to (0, 1), of these the one that y lies in or is near to.
template <class T>
OCTOBRICK_INLINE void upsample_row(const T* __restrict r00, const T* __restrict r01,
                                   const T* __restrict r10, const T* __restrict r11,
                                   std::size_t coarse_nx, std::size_t fine_nx,
                                   Sum<T>* __restrict columns, T* __restrict to) {
    for (std::size_t x = 0; x < coarse_nx; ++x) {
        const Sum<T> in = 3 * static_cast<Sum<T>>(r00[x]) + static_cast<Sum<T>>(r01[x]);
        const Sum<T> near = 3 * static_cast<Sum<T>>(r10[x]) + static_cast<Sum<T>>(r11[x]);
        columns[x + 1] = 3 * in + near;
    }
    columns[0] = columns[1];
    columns[coarse_nx + 1] = columns[coarse_nx];
    for (std::size_t k = 0; k < fine_nx / 2; ++k) {
        to[2 * k] = from_sum<T>(3 * columns[k + 1] + columns[k]);
        to[2 * k + 1] = from_sum<T>(3 * columns[k + 1] + columns[k + 2]);
    }
    if (fine_nx % 2 != 0) {
        to[fine_nx - 1] = from_sum<T>(3 * columns[coarse_nx] + columns[coarse_nx - 1]);
    }
}

template <class T>
void run_upsample2(const ConstVolume& coarse, const Volume& fine, Execution execution) {
    const Zyx from = coarse.shape, shape = fine.shape;
    const unsigned threads =
        choose_threads(execution.threads, shape.z * shape.y * shape.x * sizeof(T), shape.z);
    const auto upsample = fastest<upsample_row<T>>(execution);
    std::vector<UpsampleScratch<T>> scratch;
    scratch.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) scratch.emplace_back(coarse, fine);
    parallel_for(shape.z, threads, [&](std::size_t z, unsigned worker) {
        UpsampleScratch<T>& s = scratch[worker];
        const Pair zs = coarse_pair(z, from.z);
        for (std::size_t y = 0; y < shape.y; ++y) {
            const Pair ys = coarse_pair(y, from.y);
            upsample(s.rows[0].row(zs.in, ys.in), s.rows[1].row(zs.in, ys.near),
                     s.rows[2].row(zs.near, ys.in), s.rows[3].row(zs.near, ys.near), from.x,
                     shape.x, s.columns.data(), s.writer.row(z, y));
            s.writer.commit(z, y);
        }
    });
}

}  // namespace
}  // namespace detail

bool upsample2(const ConstVolume& coarse, const Volume& fine, Execution execution) {
    const bool empty = fine.shape.z == 0 || fine.shape.y == 0 || fine.shape.x == 0;
    if (empty || fine.type != coarse.type || coarse.shape != half_shape(fine.shape)) return false;
    detail::with_sample_type(
        fine.type, [&]<class T>(T) { detail::run_upsample2<T>(coarse, fine, execution); });
    return true;
}

}  // namespace octobrick::codec
