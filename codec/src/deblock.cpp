// The rational Bézier filter: docs/spec/deblocking.md, whose letters these are.

#include "octobrick/codec/deblock.h"

#include <algorithm>
#include <atomic>
#include <cfloat>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "bezier.h"
#include "least.h"
#include "octobrick/codec/gradients.h"
#include "parallel.h"

namespace octobrick::codec {
namespace detail {
namespace {

// Below this, exp(-x) is a float that is not denormal.
constexpr double kSafeFloatLog = 80;

struct Job {
    const Deblock& filter;
    Zyx shape;
    const float* volume;
    double low = 0, high = 0;  // of the voxels
    unsigned threads = 1;
    bool simd = true;
    double span() const { return high - low; }
    double gradient_unit() const { return filter.value_range > 0 ? filter.value_range : span(); }
    std::size_t voxels() const { return shape.z * shape.y * shape.x; }
};

// ---- Gradients and weights ----

// The least and the greatest of some numbers.
struct Extent {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();
    void include(double value) {
        low = std::min(low, value);
        high = std::max(high, value);
    }
    void include(const Extent& other) {
        low = std::min(low, other.low);
        high = std::max(high, other.high);
    }
};

// Calls body(z, extent) for every plane, and gives what all bodies included together.
template <class Body>
Extent over_planes(const Job& job, const Body& body) {
    std::vector<Extent> extents(job.shape.z);
    parallel_for(job.shape.z, job.threads, [&](std::size_t z, unsigned) { body(z, extents[z]); });
    Extent all;
    for (const Extent& extent : extents) all.include(extent);
    return all;
}

std::size_t find_range(Job& job) {
    std::atomic<std::size_t> fault{kAllFinite};
    const std::size_t plane = job.shape.y * job.shape.x;
    const Extent extent = over_planes(job, [&](std::size_t z, Extent& found) {
        for (std::size_t i = z * plane; i < (z + 1) * plane; ++i) {
            if (!std::isfinite(job.volume[i])) {
                report_least(fault, i);
                return;
            }
            found.include(double{job.volume[i]});
        }
    });
    job.low = extent.low;
    job.high = extent.high;
    return fault.load();
}

double difference(const float* at, std::size_t i, std::size_t count, std::size_t stride) {
    const float* below = i > 0 ? at - stride : at;
    const float* above = i + 1 < count ? at + stride : at;
    const double scale = i > 0 && i + 1 < count ? 0.5 : 1.0;
    return (double{*above} - double{*below}) * scale;
}

// Writes |∇| / unit of every voxel, rounded to float: so that weights that differ by a rounding
// do not, however great the strength.
Extent find_magnitudes(const Job& job, float* magnitudes) {
    const auto [nz, ny, nx] = job.shape;
    const double unit = job.gradient_unit();
    return over_planes(job, [&, nz = nz, ny = ny, nx = nx](std::size_t z, Extent& extent) {
        std::size_t i = z * ny * nx;
        for (std::size_t y = 0; y < ny; ++y) {
            for (std::size_t x = 0; x < nx; ++x, ++i) {
                const float* at = job.volume + i;
                const double gx = difference(at, x, nx, 1);
                const double gy = difference(at, y, ny, nx);
                const double gz = difference(at, z, nz, ny * nx);
                const double magnitude = std::sqrt(gx * gx + gy * gy + gz * gz) / unit;
                magnitudes[i] = static_cast<float>(std::min(magnitude, double{FLT_MAX}));
                extent.include(magnitudes[i]);
            }
        }
    });
}

// Turns magnitudes into weights exp(-λ (m - m₀)), of which the greatest is 1.
void weights_of(const Job& job, double strength, double nearest, float* magnitudes) {
    const std::size_t plane = job.shape.y * job.shape.x;
    parallel_for(job.shape.z, job.threads, [&](std::size_t z, unsigned) {
        for (std::size_t i = z * plane; i < (z + 1) * plane; ++i) {
            magnitudes[i] = static_cast<float>(std::exp(-strength * (magnitudes[i] - nearest)));
        }
    });
}

// ---- One pass along one axis ----

// An axis to filter along; lines of voxels lie side by side along the next, and layers of lines
// along the last.
struct Pass {
    std::size_t count, stride, block;
    std::size_t lines, line_stride;
    std::size_t layers, layer_stride;
};

Pass pass_of(int axis, Zyx shape, Zyx block) {
    const std::size_t row = shape.x, plane = shape.y * shape.x;
    if (axis == 0) return {shape.x, 1, std::min(block.x, shape.x), shape.y, row, shape.z, plane};
    if (axis == 1) return {shape.y, row, std::min(block.y, shape.y), shape.x, 1, shape.z, plane};
    return {shape.z, plane, std::min(block.z, shape.z), shape.x, 1, shape.y, row};
}

// The curves of an axis: between two whole blocks, and between the last whole one and what follows.
struct Curves {
    std::unique_ptr<Bezier> whole, cut;
    explicit Curves(const Pass& pass) {
        if (pass.count / pass.block >= 2) whole = std::make_unique<Bezier>(pass.block, pass.block);
        const std::size_t rest = pass.count % pass.block;
        if (pass.count > pass.block && rest > 0) cut = std::make_unique<Bezier>(pass.block, rest);
    }
    const Bezier& at(std::size_t border, const Pass& pass) const {
        return border + pass.block <= pass.count ? *whole : *cut;
    }
    double least_log() const {
        return std::min(whole ? whole->least_log() : 0, cut ? cut->least_log() : 0);
    }
};

// Adds to `change` by how much a pass moves each voxel of `volume`, in units of the span.
void run_pass(const Job& job, const Pass& pass, const Curves& curves, bool logarithmic,
              const float* volume, const float* weights, float* change) {
    if (pass.count <= pass.block) return;  // one block: no border
    std::vector<BezierPanel> panels;
    for (unsigned i = 0; i < job.threads; ++i) panels.emplace_back(2 * pass.block);
    const double strength = job.filter.strength;
    parallel_for(pass.layers, job.threads, [&](std::size_t layer, unsigned worker) {
        BezierPanel& panel = panels[worker];
        for (std::size_t border = pass.block; border < pass.count; border += pass.block) {
            const Bezier& curve = curves.at(border, pass);
            for (std::size_t line = 0; line < pass.lines; line += kBezierLanes) {
                const std::size_t lanes = std::min(kBezierLanes, pass.lines - line);
                const std::size_t origin = layer * pass.layer_stride + line * pass.line_stride +
                                           (border - pass.block) * pass.stride;
                const BezierSamples samples{volume + origin, weights + origin, pass.stride,
                                            pass.line_stride, lanes};
                if (logarithmic) {
                    curve.evaluate_logarithmic(samples, strength, panel);
                } else {
                    curve.evaluate(samples, panel, job.simd);
                }
                for (std::size_t s = curve.first(); s < curve.last(); ++s) {
                    for (std::size_t l = 0; l < lanes; ++l) {
                        const std::size_t i = origin + s * pass.stride + l * pass.line_stride;
                        const double moved = panel.result(s - curve.first(), l) - volume[i];
                        change[i] += static_cast<float>(moved / job.span());
                    }
                }
            }
        }
    });
}

// ---- The result ----

// A block of at most so many bounds between its least and its greatest voxel is coarse: codes of 1
// and 2 bits have 2 and 6, one of 3 bits has 14.
constexpr double kCoarse = 10;

double limited(double change, double bound, double block_range, DeblockLimit limit) {
    const bool automatic = limit == DeblockLimit::automatic;
    if (limit == DeblockLimit::clamp || (automatic && block_range <= kCoarse * bound)) {
        return std::clamp(change, -bound, bound);
    }
    if (bound == 0) return 0;
    const double ratio = std::fabs(change / bound);
    return change * std::max(0.0, 1 - (automatic ? ratio : ratio * ratio));
}

// The grid of blocks, and in which of them a voxel lies.
struct Grid {
    Zyx block, count;
    Grid(Zyx shape, Zyx b)
        : block(b),
          count{(shape.z - 1) / b.z + 1, (shape.y - 1) / b.y + 1, (shape.x - 1) / b.x + 1} {}
    std::size_t cells() const { return count.z * count.y * count.x; }
    std::size_t cell(std::size_t z, std::size_t y, std::size_t x) const {
        return (z / block.z * count.y + y / block.y) * count.x + x / block.x;
    }
};

// Calls body(voxel, cell) for every voxel, the planes of one layer of blocks on one thread.
template <class Body>
void over_blocks(const Job& job, const Grid& grid, const Body& body) {
    const auto [nz, ny, nx] = job.shape;
    const std::size_t deep = std::min(grid.block.z, nz);
    parallel_for(grid.count.z, job.threads,
                 [&, nz = nz, ny = ny, nx = nx](std::size_t layer, unsigned) {
                     for (std::size_t z = layer * deep; z < std::min(nz, (layer + 1) * deep); ++z) {
                         for (std::size_t y = 0; y < ny; ++y) {
                             const std::size_t row = (z * ny + y) * nx;
                             for (std::size_t x = 0; x < nx; ++x) body(row + x, grid.cell(z, y, x));
                         }
                     }
                 });
}

// out = volume + change · scale, within the voxels' range.
void apply_change(const Job& job, const float* change, double scale, const float* volume,
                  float* out) {
    const std::size_t plane = job.shape.y * job.shape.x;
    parallel_for(job.shape.z, job.threads, [&](std::size_t z, unsigned) {
        for (std::size_t i = z * plane; i < (z + 1) * plane; ++i) {
            const double moved = volume[i] + change[i] * scale;
            out[i] = static_cast<float>(std::clamp(moved, job.low, job.high));
        }
    });
}

void limit_change(const Job& job, std::span<const float> bounds, float* out) {
    const Grid grid(job.shape, job.filter.block);
    std::vector<Extent> extents(grid.cells());
    over_blocks(job, grid, [&](std::size_t i, std::size_t cell) {
        extents[cell].include(double{job.volume[i]});
    });
    const bool per_voxel = bounds.size() == job.voxels();
    over_blocks(job, grid, [&](std::size_t i, std::size_t cell) {
        const double from = job.volume[i], bound = bounds[per_voxel ? i : cell];
        const double range = extents[cell].high - extents[cell].low;
        const double moved = from + limited(out[i] - from, bound, range, job.filter.limit);
        out[i] = static_cast<float>(std::clamp(moved, job.low, job.high));
    });
}

void run_passes(const Job& job, float* out) {
    Array<float> weights(job.voxels()), change(job.voxels());
    const Pass passes[] = {pass_of(0, job.shape, job.filter.block),
                           pass_of(1, job.shape, job.filter.block),
                           pass_of(2, job.shape, job.filter.block)};
    const Curves curves[] = {Curves(passes[0]), Curves(passes[1]), Curves(passes[2])};
    const double strength = job.filter.strength;

    const Extent extent = find_magnitudes(job, weights.data());
    const double reach = std::fabs(strength) * (extent.high - extent.low);
    bool logarithmic = !(reach < kSafeFloatLog);
    for (const Curves& c : curves) logarithmic |= !(reach - c.least_log() < kSafeDoubleLog);
    if (!logarithmic) {
        weights_of(job, strength, strength < 0 ? extent.high : extent.low, weights.data());
    }

    const bool sequential = job.filter.axes == DeblockAxes::sequential;
    const float* from = job.volume;
    for (int axis = 0; axis < 3; ++axis) {
        run_pass(job, passes[axis], curves[axis], logarithmic, from, weights.data(), change.data());
        if (sequential) {
            apply_change(job, change.data(), job.span(), from, out);
            std::fill_n(change.data(), job.voxels(), 0.0f);
            from = out;
        }
    }
    if (!sequential) apply_change(job, change.data(), job.span() / 3, job.volume, out);
}

}  // namespace
}  // namespace detail

std::size_t deblock(const Deblock& filter, std::span<const float> volume, Zyx shape,
                    std::span<const float> bounds, std::span<float> out, Execution execution) {
    const std::size_t most = std::max({shape.z, shape.y, shape.x});
    const unsigned threads = detail::choose_threads(execution.threads, volume.size_bytes(), most);
    detail::Job job{filter, shape, volume.data()};
    job.threads = threads;
    job.simd = execution.simd;
    if (const std::size_t at = detail::find_range(job); at != kAllFinite) return at;
    if (job.low == job.high) {
        std::copy(volume.begin(), volume.end(), out.begin());
        return kAllFinite;
    }
    detail::run_passes(job, out.data());
    if (!bounds.empty()) detail::limit_change(job, bounds, out.data());
    return kAllFinite;
}

}  // namespace octobrick::codec
