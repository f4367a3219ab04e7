// Central differences and the magnitude-weighted reduction of gradients.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <type_traits>
#include <vector>

#include "least.h"
#include "octobrick/codec/gradients.h"
#include "octobrick/codec/reduce.h"
#include "parallel.h"
#include "rows.h"
#include "stencil.h"
#include "store_vector.h"

namespace octobrick::codec {
namespace detail {
namespace {

// ---- Central differences ----

template <class T>
std::size_t first_not_finite(const T* row, std::size_t nx) {
    if constexpr (std::is_floating_point_v<T>) {
        for (std::size_t x = 0; x < nx; ++x) {
            if (!std::isfinite(row[x])) return x;
        }
    }
    return nx;
}

template <class T>
struct FiveRows {
    explicit FiveRows(const ConstVolume& v) : here(v), y0(v), y1(v), z0(v), z1(v) {}
    RowReader<T> here, y0, y1, z0, z1;
};

template <class T>
std::size_t run_differences(const ConstVolume& v, const double (&spacing)[3], float* gradient,
                            Execution execution) {
    const auto [nz, ny, nx] = v.shape;
    const unsigned threads = choose_threads(execution.threads, nz * ny * nx * sizeof(T), nz);
    const std::vector<Stencil> along_x = [&, n = nx] {
        std::vector<Stencil> stencils;
        stencils.reserve(n);
        for (std::size_t x = 0; x < n; ++x) stencils.emplace_back(x, n, spacing[2]);
        return stencils;
    }();
    std::vector<FiveRows<T>> rows;
    rows.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) rows.emplace_back(v);

    std::atomic<std::size_t> fault{kAllFinite};
    parallel_for(nz, threads, [&, ny = ny, nx = nx, nz = nz](std::size_t z, unsigned worker) {
        const FiveRows<T>& r = rows[worker];
        const Stencil in_z(z, nz, spacing[0]);
        for (std::size_t y = 0; y < ny; ++y) {
            const Stencil in_y(y, ny, spacing[1]);
            const T* here = r.here.row(z, y);
            const T *y0 = r.y0.row(z, in_y.below), *y1 = r.y1.row(z, in_y.above);
            const T *z0 = r.z0.row(in_z.below, y), *z1 = r.z1.row(in_z.above, y);
            const std::size_t row = (z * ny + y) * nx;
            if (const std::size_t x = first_not_finite(here, nx); x < nx) {
                report_least(fault, row + x);
                return;
            }
            for (std::size_t x = 0; x < nx; ++x) {
                const Stencil& in_x = along_x[x];
                store_vector(difference(here[in_x.above], here[in_x.below], in_x.scale),
                             difference(y1[x], y0[x], in_y.scale),
                             difference(z1[x], z0[x], in_z.scale), gradient + 3 * (row + x));
            }
        }
    });
    return fault.load();
}

// ---- Reduction ----

// g(k + 1/2) for k = 0 .. radius - 1, relative to g(1/2): so that the nearest voxels weigh 1, and
// the sum of weights cannot vanish, however narrow the Gaussian.
std::vector<double> half_kernel(unsigned radius, double sigma) {
    std::vector<double> weights(radius);
    for (unsigned k = 0; k < radius; ++k) {
        const double distance = k + 0.5;
        weights[k] = std::exp((0.5 - distance) / sigma * ((0.5 + distance) / sigma) / 2);
    }
    return weights;
}

// The fine voxels under coarse voxel i, and the weight of each: centred between 2i and 2i + 1.
struct Support {
    std::size_t first, last;  // last is not included
    std::size_t coarse;
    const std::vector<double>* kernel;
    Support(std::size_t i, std::size_t n, const std::vector<double>& half)
        : first(2 * i + 1 > half.size() ? 2 * i + 1 - half.size() : 0),
          last(std::min(n, 2 * i + 1 + half.size())),
          coarse(i),
          kernel(&half) {}
    double weight(std::size_t at) const {
        const std::size_t k = at > 2 * coarse ? at - 2 * coarse - 1 : 2 * coarse - at;
        return (*kernel)[k];
    }
};

struct WeightedSum {
    double x = 0, y = 0, z = 0, weights = 0;
    void add(const float* gradient, double g) {
        const double gx = gradient[0], gy = gradient[1], gz = gradient[2];
        const double weight = g * std::sqrt(gx * gx + gy * gy + gz * gz);
        x += weight * gx;
        y += weight * gy;
        z += weight * gz;
        weights += weight;
    }
    void store(float* out) const {
        const double divisor = weights == 0 ? 1 : weights;  // NaN is not 0, and spreads
        out[0] = static_cast<float>(x / divisor);
        out[1] = static_cast<float>(y / divisor);
        out[2] = static_cast<float>(z / divisor);
    }
};

WeightedSum sum_support(const float* fine, Zyx shape, const Support& in_z, const Support& in_y,
                        const Support& in_x) {
    WeightedSum sum;
    for (std::size_t z = in_z.first; z < in_z.last; ++z) {
        for (std::size_t y = in_y.first; y < in_y.last; ++y) {
            const double weight_zy = in_z.weight(z) * in_y.weight(y);
            const float* row = fine + 3 * (z * shape.y + y) * shape.x;
            for (std::size_t x = in_x.first; x < in_x.last; ++x) {
                sum.add(row + 3 * x, weight_zy * in_x.weight(x));
            }
        }
    }
    return sum;
}

}  // namespace
}  // namespace detail

std::size_t central_differences(const ConstVolume& volume, const double (&spacing_zyx)[3],
                                std::span<float> gradient, Execution execution) {
    return detail::with_sample_type(volume.type, [&]<class T>(T) {
        return detail::run_differences<T>(volume, spacing_zyx, gradient.data(), execution);
    });
}

void reduce_gradient(std::span<const float> fine, Zyx shape, unsigned radius, double sigma,
                     std::span<float> coarse, Execution execution) {
    const std::vector<double> kernel = detail::half_kernel(radius, sigma);
    const Zyx half = half_shape(shape);
    const unsigned threads =
        detail::choose_threads(execution.threads, fine.size() * sizeof(float), half.z);
    detail::parallel_for(half.z, threads, [&](std::size_t z, unsigned) {
        const detail::Support in_z(z, shape.z, kernel);
        for (std::size_t y = 0; y < half.y; ++y) {
            const detail::Support in_y(y, shape.y, kernel);
            float* out = coarse.data() + 3 * (z * half.y + y) * half.x;
            for (std::size_t x = 0; x < half.x; ++x, out += 3) {
                const detail::Support in_x(x, shape.x, kernel);
                detail::sum_support(fine.data(), shape, in_z, in_y, in_x).store(out);
            }
        }
    });
}

}  // namespace octobrick::codec
