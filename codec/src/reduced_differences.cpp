// Central differences and their reduction in one go: no fine gradient is ever stored.

#include <algorithm>
#include <atomic>
#include <bit>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <vector>

#include "least.h"
#include "octobrick/codec/gradients.h"
#include "octobrick/codec/reduce.h"
#include "parallel.h"
#include "rows.h"
#include "simd.h"
#include "stencil.h"
#include "store_vector.h"

namespace octobrick::codec {
namespace detail {
namespace {

// A row of fine voxels. `here` has one more at either end: the neighbour, or at a face of the
// volume the voxel itself, for which `scale_x` then makes up.
template <class T>
struct FineRow {
    std::size_t nx;
    const T *here, *y0, *y1, *z0, *z1;
    const double* scale_x;
    double scale_y, scale_z;
};

// The gradient of a row.
struct GradientRow {
    explicit GradientRow(std::size_t n) : x(n), y(n), z(n) {}
    Array<float> x, y, z;
};

// Per voxel of a fine row its magnitude, and its gradient multiplied by it.
struct WeightedRow {
    explicit WeightedRow(std::size_t n) : x(n), y(n), z(n), weight(n) {}
    Array<double> x, y, z, weight;
};

// The bits of |v|, which order like it; those of NaN are greater than all.
OCTOBRICK_INLINE std::int64_t size_bits(double v) {
    return std::bit_cast<std::int64_t>(v) & INT64_MAX;
}

// One component. Returns the greatest size_bits of what was rounded to float.
template <class T, class Scale>
OCTOBRICK_INLINE std::int64_t differentiate(const T* __restrict above, const T* __restrict below,
                                            const Scale& scale, std::size_t n,
                                            float* __restrict out) {
    std::int64_t greatest = 0;
    for (std::size_t i = 0; i < n; ++i) {
        const double d = difference(above[i], below[i], scale(i));
        const std::int64_t size = size_bits(d);
        greatest = greatest > size ? greatest : size;
        out[i] = static_cast<float>(d);
    }
    return greatest;
}

// Returns whether a component is beyond the greatest float, and `out` so unspecified. Loops of
// their own for the components, or a vector of samples would make sixteen of doubles.
template <class T>
OCTOBRICK_INLINE bool weigh(const FineRow<T>& r, const GradientRow& gradient,
                            const WeightedRow& out) {
    const std::size_t n = r.nx;
    const double *scale_x = r.scale_x, scale_y = r.scale_y, scale_z = r.scale_z;
    const auto x = [=](std::size_t i) OCTOBRICK_INLINE_LAMBDA { return scale_x[i]; };
    const auto y = [=](std::size_t) OCTOBRICK_INLINE_LAMBDA { return scale_y; };
    const auto z = [=](std::size_t) OCTOBRICK_INLINE_LAMBDA { return scale_z; };
    const std::int64_t sizes[] = {differentiate(r.here + 2, r.here, x, n, gradient.x.data()),
                                  differentiate(r.y1, r.y0, y, n, gradient.y.data()),
                                  differentiate(r.z1, r.z0, z, n, gradient.z.data())};
    const float* __restrict from_x = gradient.x.data();
    const float* __restrict from_y = gradient.y.data();
    const float* __restrict from_z = gradient.z.data();
    double* __restrict to_x = out.x.data();
    double* __restrict to_y = out.y.data();
    double* __restrict to_z = out.z.data();
    double* __restrict to_weight = out.weight.data();
    for (std::size_t i = 0; i < n; ++i) {
        const double gx = from_x[i], gy = from_y[i], gz = from_z[i];
        const double weight = std::sqrt(gx * gx + gy * gy + gz * gz);
        to_x[i] = weight * gx;
        to_y[i] = weight * gy;
        to_z[i] = weight * gz;
        to_weight[i] = weight;
    }
    return *std::max_element(std::begin(sizes), std::end(sizes)) > size_bits(FLT_MAX);
}

// The same for rows that have components beyond the greatest float.
template <class T>
void weigh_scaled(const FineRow<T>& r, const WeightedRow& out) {
    for (std::size_t i = 0; i < r.nx; ++i) {
        float g[3];
        store_vector(difference(r.here[i + 2], r.here[i], r.scale_x[i]),
                     difference(r.y1[i], r.y0[i], r.scale_y),
                     difference(r.z1[i], r.z0[i], r.scale_z), g);
        const double gx = g[0], gy = g[1], gz = g[2];
        const double weight = std::sqrt(gx * gx + gy * gy + gz * gz);
        out.x[i] = weight * gx, out.y[i] = weight * gy, out.z[i] = weight * gz;
        out.weight[i] = weight;
    }
}

// Adds pairs of fine voxels, the left one first: reduce_gradient sums in this order.
OCTOBRICK_INLINE void add_pairs(const double* __restrict fine, double* __restrict sums,
                                std::size_t ncoarse) {
    for (std::size_t i = 0; i < ncoarse; ++i) sums[i] = (sums[i] + fine[2 * i]) + fine[2 * i + 1];
}

OCTOBRICK_INLINE void add_row(const WeightedRow& fine, const WeightedRow& sums,
                              std::size_t ncoarse) {
    add_pairs(fine.x.data(), sums.x.data(), ncoarse);
    add_pairs(fine.y.data(), sums.y.data(), ncoarse);
    add_pairs(fine.z.data(), sums.z.data(), ncoarse);
    add_pairs(fine.weight.data(), sums.weight.data(), ncoarse);
}

// Returns the first vector that is not finite, or `ncoarse`.
OCTOBRICK_INLINE std::size_t store_sums(const WeightedRow& sums, std::size_t ncoarse,
                                        float* __restrict out) {
    float off = 0;  // NaN as soon as one is not finite
    for (std::size_t i = 0; i < ncoarse; ++i) {
        const double weight = sums.weight[i], divisor = weight == 0 ? 1 : weight;
        const float x = static_cast<float>(sums.x[i] / divisor);
        const float y = static_cast<float>(sums.y[i] / divisor);
        const float z = static_cast<float>(sums.z[i] / divisor);
        out[3 * i] = x, out[3 * i + 1] = y, out[3 * i + 2] = z;
        off += (x - x) + (y - y) + (z - z);
    }
    std::size_t i = ncoarse;
    if (!(off == 0)) {
        for (i = 0; i < ncoarse; ++i) {
            if (!std::isfinite(out[3 * i] + out[3 * i + 1] + out[3 * i + 2])) break;
        }
    }
    return i;
}

// What one thread needs.
template <class T>
struct Scratch {
    Scratch(const ConstVolume& v, std::size_t nx)
        : here(v),
          y0(v),
          y1(v),
          z0(v),
          z1(v),
          padded(nx + 2),
          gradient(nx),
          fine(nx + 1),
          sums((nx + 1) / 2) {}
    RowReader<T> here, y0, y1, z0, z1;
    Array<T> padded;
    GradientRow gradient;
    WeightedRow fine, sums;  // of `fine` one more than the row: where nx is odd, it stays 0
};

template <class T>
class Reducer {
  public:
    Reducer(const ConstVolume& volume, const Part& part, const double (&spacing)[3],
            Execution execution)
        : volume_(volume),
          part_(part),
          spacing_{spacing[0], spacing[1], spacing[2]},
          scale_x_(part.shape.x),
          weigh_(fastest<weigh<T>, true>(execution)),
          add_row_(fastest<add_row, true>(execution)),
          store_(fastest<store_sums, true>(execution)) {
        for (std::size_t x = 0; x < part.shape.x; ++x) {
            scale_x_[x] = Stencil(part.start.x + x, volume.shape.x, spacing[2]).scale;
        }
    }

    // Writes one coarse row; returns the first vector in it that is not finite, or its length.
    std::size_t reduce_row(std::size_t z, std::size_t y, Scratch<T>& s, float* out) const {
        const std::size_t ncoarse = half_shape(part_.shape).x;
        for (double* sums :
             {s.sums.x.data(), s.sums.y.data(), s.sums.z.data(), s.sums.weight.data()}) {
            std::fill_n(sums, ncoarse, 0.0);
        }
        for (std::size_t at_z = 2 * z; at_z < std::min(2 * z + 2, part_.shape.z); ++at_z) {
            for (std::size_t at_y = 2 * y; at_y < std::min(2 * y + 2, part_.shape.y); ++at_y) {
                const FineRow<T> row = fine_row(part_.start.z + at_z, part_.start.y + at_y, s);
                if (weigh_(row, s.gradient, s.fine)) weigh_scaled(row, s.fine);
                add_row_(s.fine, s.sums, ncoarse);
            }
        }
        return store_(s.sums, ncoarse, out);
    }

  private:
    FineRow<T> fine_row(std::size_t z, std::size_t y, Scratch<T>& s) const {
        const Stencil in_z(z, volume_.shape.z, spacing_[0]);
        const Stencil in_y(y, volume_.shape.y, spacing_[1]);
        const std::size_t start = part_.start.x, nx = part_.shape.x;
        pad(s.here.row(z, y), s.padded.data());
        return {nx,
                s.padded.data(),
                s.y0.row(z, in_y.below) + start,
                s.y1.row(z, in_y.above) + start,
                s.z0.row(in_z.below, y) + start,
                s.z1.row(in_z.above, y) + start,
                scale_x_.data(),
                in_y.scale,
                in_z.scale};
    }

    // The part's voxels of a row, with the neighbour at either end, or the last voxel twice.
    void pad(const T* row, T* padded) const {
        const std::size_t start = part_.start.x, nx = part_.shape.x;
        padded[0] = row[start > 0 ? start - 1 : 0];
        std::copy_n(row + start, nx, padded + 1);
        padded[nx + 1] = row[std::min(start + nx, volume_.shape.x - 1)];
    }

    ConstVolume volume_;
    Part part_;
    double spacing_[3];
    Array<double> scale_x_;
    bool (*weigh_)(const FineRow<T>&, const GradientRow&, const WeightedRow&);
    void (*add_row_)(const WeightedRow&, const WeightedRow&, std::size_t);
    std::size_t (*store_)(const WeightedRow&, std::size_t, float*);
};

template <class T>
std::size_t run(const ConstVolume& volume, const Part& part, const double (&spacing)[3],
                float* coarse, Execution execution) {
    const Zyx half = half_shape(part.shape);
    const std::size_t nbytes = part.shape.z * part.shape.y * part.shape.x * sizeof(T);
    const unsigned threads = choose_threads(execution.threads, nbytes, half.z);
    const Reducer<T> reducer(volume, part, spacing, execution);
    std::vector<Scratch<T>> scratch;
    scratch.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) scratch.emplace_back(volume, part.shape.x);

    std::atomic<std::size_t> fault{kAllFinite};
    parallel_for(half.z, threads, [&](std::size_t z, unsigned worker) {
        for (std::size_t y = 0; y < half.y; ++y) {
            const std::size_t row = (z * half.y + y) * half.x;
            const std::size_t x = reducer.reduce_row(z, y, scratch[worker], coarse + 3 * row);
            if (x < half.x) return report_least(fault, row + x);
        }
    });
    return fault.load();
}

}  // namespace
}  // namespace detail

std::size_t reduced_differences(const ConstVolume& volume, const Part& part,
                                const double (&spacing_zyx)[3], std::span<float> coarse,
                                Execution execution) {
    return detail::with_sample_type(volume.type, [&]<class T>(T) {
        return detail::run<T>(volume, part, spacing_zyx, coarse.data(), execution);
    });
}

}  // namespace octobrick::codec
