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
#include "deblock_blocks.h"
#include "least.h"
#include "octobrick/codec/gradients.h"
#include "parallel.h"

namespace octobrick::codec {
namespace detail {
namespace {

// Below this, exp(-x) is a float that is not denormal.
constexpr double kSafeFloatLog = 80;

// No gradient of voxels within a range is steeper, measured against it: √3, rounded up.
constexpr double kSteepest = 1.7320509;

struct Job {
    const Deblock& filter;
    Zyx shape;
    const float* volume;
    std::span<const float> bounds;
    double low = 0, high = 0;  // of the voxels, or of the whole that they are a part of
    bool is_part = false;
    unsigned threads = 1;
    bool simd = true;
    double span() const { return high - low; }
    double gradient_unit() const { return filter.value_range > 0 ? filter.value_range : span(); }
    std::size_t voxels() const { return shape.z * shape.y * shape.x; }
};

// ---- The range ----

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

std::size_t find_range(const Job& job, Extent& extent) {
    std::atomic<std::size_t> fault{kAllFinite};
    const std::size_t plane = job.shape.y * job.shape.x;
    extent = over_planes(job, [&](std::size_t z, Extent& found) {
        for (std::size_t i = z * plane; i < (z + 1) * plane; ++i) {
            if (!std::isfinite(job.volume[i])) {
                report_least(fault, i);
                return;
            }
            found.include(double{job.volume[i]});
        }
    });
    return fault.load();
}

// ---- Gradients and weights ----

double difference(const float* at, std::size_t i, std::size_t count, std::size_t stride) {
    const float* below = i > 0 ? at - stride : at;
    const float* above = i + 1 < count ? at + stride : at;
    const double scale = i > 0 && i + 1 < count ? 0.5 : 1.0;
    return (double{*above} - double{*below}) * scale;
}

// Writes |∇| / unit of a run's voxels, rounded to float: so that weights that differ by a rounding
// do not, however great the strength.
Extent find_magnitudes(const Job& job, const Run& run, float* magnitudes) {
    const auto [nz, ny, nx] = job.shape;
    const double unit = job.gradient_unit();
    Extent extent;
    for (std::size_t x = run.x, i = run.first; x < run.end; ++x, ++i) {
        const float* at = job.volume + i;
        const double gx = difference(at, x, nx, 1);
        const double gy = difference(at, run.y, ny, nx);
        const double gz = difference(at, run.z, nz, ny * nx);
        const double magnitude = std::sqrt(gx * gx + gy * gy + gz * gz) / unit;
        magnitudes[i] = static_cast<float>(std::min(magnitude, double{FLT_MAX}));
        extent.include(magnitudes[i]);
    }
    return extent;
}

// Fills `weights` with magnitudes, but for those that nobody needs; their extent. That of a part
// is the same for all parts, so that weights do not depend on where a volume was cut.
Extent find_magnitudes(const Job& job, const Grid& grid, const std::vector<bool>& idle,
                       float* weights) {
    std::vector<Extent> extents(grid.count.z);
    over_blocks(grid, job.threads, [&](const Run& run) {
        if (job.is_part && idle[run.cell]) return;
        extents[run.z / grid.block.z].include(find_magnitudes(job, run, weights));
    });
    if (job.is_part) return {0, kSteepest};
    Extent all;
    for (const Extent& extent : extents) all.include(extent);
    return all;
}

// Turns magnitudes into weights exp(-λ (m - m₀)), of which the greatest is 1, or for a part near
// it.
void find_weights(const Job& job, const Grid& grid, const std::vector<bool>& idle, double nearest,
                  float* magnitudes) {
    const double strength = job.filter.strength;
    over_blocks(grid, job.threads, [&](const Run& run) {
        if (idle[run.cell]) return;
        for (std::size_t i = run.first; i < run.last(); ++i) {
            magnitudes[i] = static_cast<float>(std::exp(-strength * (magnitudes[i] - nearest)));
        }
    });
}

// ---- One pass along one axis ----

// An axis to filter along; lines of voxels lie side by side along the next, and layers of lines
// along the last.
struct Pass {
    int axis;  // 0 is x
    std::size_t count, stride, block;
    std::size_t lines, line_stride;
    std::size_t layers, layer_stride;
    // Where the voxel of a line, at a place along it, lies.
    Zyx at(std::size_t place, std::size_t line, std::size_t layer) const {
        if (axis == 0) return {layer, line, place};
        if (axis == 1) return {layer, place, line};
        return {place, layer, line};
    }
};

Pass pass_of(int axis, Zyx shape, Zyx block) {
    const std::size_t row = shape.x, plane = shape.y * shape.x;
    if (axis == 0) return {0, shape.x, 1, std::min(block.x, shape.x), shape.y, row, shape.z, plane};
    if (axis == 1) return {1, shape.y, row, std::min(block.y, shape.y), shape.x, 1, shape.z, plane};
    return {2, shape.z, plane, std::min(block.z, shape.z), shape.x, 1, shape.y, row};
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

// Adds to `change` by how much a pass moves each voxel of `volume`, in units of the span; where
// blocks are kept it may be nothing.
void run_pass(const Job& job, const Pass& pass, const Curves& curves, const Kept& kept,
              bool logarithmic, const float* volume, const float* weights, float* change) {
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
                const Grid& grid = kept.grid();
                if (kept.all(grid.cell_of(pass.at(border - 1, line, layer)),
                             grid.cell_of(pass.at(border, line + lanes - 1, layer)))) {
                    continue;
                }
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
// The part of the bound that a change of such a block may have: few errors are as large as the
// bound, and thin features move by as much.
constexpr double kCoarseShare = 0.4;

double limited(double change, double bound, double block_range, DeblockLimit limit) {
    const bool automatic = limit == DeblockLimit::automatic;
    if (limit == DeblockLimit::clamp) return std::clamp(change, -bound, bound);
    if (automatic && block_range <= kCoarse * bound) {
        return std::clamp(change, -kCoarseShare * bound, kCoarseShare * bound);
    }
    if (bound == 0) return 0;
    const double ratio = std::fabs(change / bound);
    return change * std::max(0.0, 1 - (automatic ? ratio : ratio * ratio));
}

// out = volume + change · scale, within the voxels' range.
void apply_change(const Job& job, const Kept& kept, const float* change, double scale,
                  const float* volume, float* out) {
    over_blocks(kept.grid(), job.threads, [&](const Run& run) {
        if (kept(run.cell)) {
            std::copy(volume + run.first, volume + run.last(), out + run.first);
            return;
        }
        for (std::size_t i = run.first; i < run.last(); ++i) {
            const double moved = volume[i] + change[i] * scale;
            out[i] = static_cast<float>(std::clamp(moved, job.low, job.high));
        }
    });
}

void limit_change(const Job& job, const Kept& kept, float* out) {
    std::vector<Extent> extents(kept.grid().cells());
    const bool per_voxel = job.bounds.size() == job.voxels();
    over_blocks(kept.grid(), job.threads, [&](const Run& run) {
        if (kept(run.cell)) return;
        for (std::size_t i = run.first; i < run.last(); ++i) {
            extents[run.cell].include(double{job.volume[i]});
        }
    });
    over_blocks(kept.grid(), job.threads, [&](const Run& run) {
        if (kept(run.cell)) return;
        const double range = extents[run.cell].high - extents[run.cell].low;
        for (std::size_t i = run.first; i < run.last(); ++i) {
            const double from = job.volume[i], bound = job.bounds[per_voxel ? i : run.cell];
            const double moved = from + limited(out[i] - from, bound, range, job.filter.limit);
            out[i] = static_cast<float>(std::clamp(moved, job.low, job.high));
        }
    });
}

void run_passes(const Job& job, const Kept& kept, float* out) {
    Array<float> weights(job.voxels()), change(job.voxels());
    const Pass passes[] = {pass_of(0, job.shape, job.filter.block),
                           pass_of(1, job.shape, job.filter.block),
                           pass_of(2, job.shape, job.filter.block)};
    const Curves curves[] = {Curves(passes[0]), Curves(passes[1]), Curves(passes[2])};
    const double strength = job.filter.strength;

    const std::vector<bool> idle = kept.idle();
    const Extent extent = find_magnitudes(job, kept.grid(), idle, weights.data());
    const double reach = std::fabs(strength) * (extent.high - extent.low);
    bool logarithmic = !(reach < kSafeFloatLog);
    for (const Curves& c : curves) logarithmic |= !(reach - c.least_log() < kSafeDoubleLog);
    if (!logarithmic) {
        const double nearest = strength < 0 ? extent.high : extent.low;
        find_weights(job, kept.grid(), idle, nearest, weights.data());
    }

    const bool sequential = job.filter.axes == DeblockAxes::sequential;
    const float* from = job.volume;
    for (int axis = 0; axis < 3; ++axis) {
        run_pass(job, passes[axis], curves[axis], kept, logarithmic, from, weights.data(),
                 change.data());
        if (sequential) {
            apply_change(job, kept, change.data(), job.span(), from, out);
            std::fill_n(change.data(), job.voxels(), 0.0f);
            from = out;
        }
    }
    if (!sequential) apply_change(job, kept, change.data(), job.span() / 3, job.volume, out);
}

}  // namespace
}  // namespace detail

std::size_t deblock(const Deblock& filter, std::span<const float> volume, Zyx shape,
                    std::span<const float> bounds, std::span<float> out, Execution execution) {
    const std::size_t most = std::max({shape.z, shape.y, shape.x});
    const unsigned threads = detail::choose_threads(execution.threads, volume.size_bytes(), most);
    detail::Job job{filter, shape, volume.data(), bounds};
    job.threads = threads;
    job.simd = execution.simd;
    detail::Extent extent;
    if (const std::size_t at = detail::find_range(job, extent); at != kAllFinite) return at;
    // Measured against less than its range, a gradient can be steeper than kSteepest.
    const bool wide = !(filter.value_range > 0 && filter.value_range < filter.high - filter.low);
    job.is_part =
        wide && filter.low < filter.high && filter.low <= extent.low && extent.high <= filter.high;
    job.low = job.is_part ? filter.low : extent.low;
    job.high = job.is_part ? filter.high : extent.high;
    if (extent.low == extent.high) {
        std::copy(volume.begin(), volume.end(), out.begin());
        return kAllFinite;
    }
    const detail::Grid grid(shape, filter.block);
    // Not where passes build on each other: what one does to a kept block, the next sees.
    const bool keep = filter.axes == DeblockAxes::average && bounds.size() == grid.cells();
    const detail::Kept kept(grid, keep ? bounds : std::span<const float>());
    detail::run_passes(job, kept, out.data());
    if (!bounds.empty()) detail::limit_change(job, kept, out.data());
    return kAllFinite;
}

}  // namespace octobrick::codec
