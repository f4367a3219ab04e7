#include <algorithm>
#include <cmath>
#include <vector>

#include "faults.h"
#include "octobrick/codec/s3dc_variable.h"
#include "parallel.h"
#include "s3dc_variable_format.h"
#include "slope_histogram.h"
#include "variable_block.h"

namespace octobrick::codec {
namespace detail {
namespace {

// Gathers every block of a line along x, and calls f(its number).
template <class T, class F>
OCTOBRICK_INLINE void for_each_block(const EncodeJob& job, EncodeScratch<T>& scratch,
                                     std::size_t slab, const F& f) {
    const VariableLayout& layout = job.layout;
    std::size_t block = slab * layout.grid.x;
    const Zyx first = place_of(block, layout.grid);
    const Zyx begin = {first.z * layout.block.z, first.y * layout.block.y, 0};
    const Zyx extent = extent_of(first, layout.block, job.voxels.shape);
    const Zyx end = {begin.z + extent.z, begin.y + extent.y, 0};
    scratch.rows.open(begin, end);
    if (job.prediction != nullptr) scratch.prediction_rows.open(begin, end);
    for (Zyx at = first; at.x < layout.grid.x; ++at.x, ++block) {
        const std::size_t x = at.x * layout.block.x;
        scratch.block.gather(scratch.rows, x, extent_of(at, layout.block, job.voxels.shape));
        if (job.prediction != nullptr) scratch.block.gather_prediction(scratch.prediction_rows, x);
        f(block);
    }
}

template <class T>
OCTOBRICK_INLINE void examine_slab(const EncodeJob& job, EncodeScratch<T>& scratch,
                                   std::size_t slab) {
    for_each_block(job, scratch, slab, [&](std::size_t block) OCTOBRICK_INLINE_LAMBDA {
        examine_block(job, scratch, block);
    });
}

template <class T>
OCTOBRICK_INLINE void write_slab(const EncodeJob& job, EncodeScratch<T>& scratch,
                                 std::size_t slab) {
    const Tables tables(job.layout, job.code, job.voxels.type);
    for_each_block(job, scratch, slab, [&](std::size_t block) OCTOBRICK_INLINE_LAMBDA {
        write_block(job, scratch, block, job.code + (tables.payload(block) - job.code));
    });
}

template <class T, class Slab>
void for_each_slab(const EncodeJob& job, Execution execution, const Slab& slab_of) {
    const Zyx shape = job.voxels.shape;
    const std::size_t slabs = job.layout.grid.z * job.layout.grid.y;
    const unsigned threads =
        choose_threads(execution.threads, shape.z * shape.y * shape.x * sizeof(T), slabs);
    std::vector<EncodeScratch<T>> scratch;
    scratch.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) scratch.emplace_back(job);
    parallel_for(slabs, threads,
                 [&](std::size_t slab, unsigned worker) { slab_of(job, scratch[worker], slab); });
}

FindLevels levels_for(SampleType type, Execution execution) {
    return find_levels_for(type != SampleType::f32, execution);
}

// What a raw block takes, in units; 0 where the type has none.
std::uint32_t raw_units(SampleType type) {
    return sample_nbytes(type) > 1 ? static_cast<std::uint32_t>(units_of(kRaw, type)) : 0;
}

// Looks at every block, and chooses widths.
void examine(const EncodeJob& job, Execution execution) {
    const Kind kind = job.codec.widths.kind;
    const bool by_curve = kind == Kind::budget || kind == Kind::slope;
    if (by_curve) job.choices.curves.resize(job.layout.blocks);
    with_sample_type(job.voxels.type, [&]<class T>(T) {
        for_each_slab<T>(job, execution, fastest<examine_slab<T>, true>(execution));
    });
}

// The units that a budget leaves for the payload.
double units_for(const EncodeJob& job, double bits_per_voxel) {
    const Zyx shape = job.voxels.shape;
    const double voxels = static_cast<double>(shape.z * shape.y * shape.x);
    const double nbytes =
        bits_per_voxel * voxels / 8 - static_cast<double>(job.layout.payload_begin);
    // A hair more, so that the bits that a refused budget was told to have are enough.
    return std::floor(nbytes / static_cast<double>(job.layout.unit_nbytes) + 1e-6);
}

void choose(const EncodeJob& job) {
    Choices& choices = job.choices;
    if (choices.curves.empty()) return;
    const double value = job.codec.widths.value;
    const std::uint32_t raw = raw_units(job.voxels.type);
    if (job.codec.widths.kind == Kind::budget) {
        const double most = 64.0 * static_cast<double>(job.layout.blocks);
        const auto units = static_cast<std::uint64_t>(std::min(units_for(job, value), most));
        choose_widths(choices.curves, raw, units, choices.widths);
    } else {
        // A unit is a bit for each index of a block, those of voxels that it has not included.
        const double per_unit = value * static_cast<double>(job.layout.unit_nbytes) * 8;
        choose_widths_by_slope(choices.curves, raw, per_unit, choices.widths);
    }
    for (std::size_t i = 0; i < job.layout.blocks; ++i) {
        choices.predicted[i] = choices.curves[i].predicted >> choices.widths[i] & 1;
    }
}

// Writes the tables; the size of the code is what they need.
void write_tables(const EncodeJob& job, std::vector<std::byte>& code) {
    const VariableLayout& layout = job.layout;
    std::uint64_t units = 0;
    for (const std::uint8_t width : job.choices.widths) units += units_of(width, job.voxels.type);
    code.assign(layout.payload_begin + units * layout.unit_nbytes, std::byte{0});
    auto* bytes = reinterpret_cast<std::uint8_t*>(code.data());
    std::uint32_t first = 0;
    for (std::size_t block = 0; block < layout.blocks; block += kGroup) {
        std::uint32_t widths = 0, here = 0, flags = 0;
        for (std::size_t i = 0; i < std::min(kGroup, layout.blocks - block); ++i) {
            const std::uint32_t width = job.choices.widths[block + i];
            widths |= width << 4 * i;
            flags |= std::uint32_t{job.choices.predicted[block + i]} << i;
            here += static_cast<std::uint32_t>(units_of(width, job.voxels.type));
        }
        std::uint8_t* entry = bytes + layout.groups_begin + kGroup_nbytes * (block / kGroup);
        store32(entry, first);
        store32(entry + 4, widths);
        if (job.prediction != nullptr) {
            bytes[layout.flags_begin + block / kGroup] = static_cast<std::uint8_t>(flags);
        }
        first += here;
    }
}

// Checks all that can be wrong before work begins.
Outcome check_job(const VariableS3dc& codec, const ConstVolume& voxels,
                  const ConstVolume* prediction, VariableLayout& layout) {
    const Status status =
        make_variable_layout(codec.block, voxels.type, voxels.shape, prediction != nullptr, layout);
    if (status != Status::ok) return {status, {}, 0, 0};
    const double value = codec.widths.value;
    const bool good = codec.widths.kind == Kind::same
                          ? value >= 0 && value <= 8 && value == std::floor(value)
                      : codec.widths.kind == Kind::slope ? value > 0
                                                         : value >= 0 && std::isfinite(value);
    if (!good) return {Status::bad_widths, {}, value, 0};
    const Outcome predicted = check_prediction(prediction, voxels.type, voxels.shape);
    if (predicted.status != Status::ok) return predicted;
    return voxels.type == SampleType::f32 ? find_not_finite(voxels) : Outcome{};
}

}  // namespace
}  // namespace detail

Outcome encode_variable(const VariableS3dc& codec, const ConstVolume& voxels,
                        const ConstVolume* prediction, std::vector<std::byte>& code,
                        Execution execution) {
    using namespace detail;
    VariableLayout layout;
    const Outcome checked = check_job(codec, voxels, prediction, layout);
    if (checked.status != Status::ok) return checked;
    Choices choices(layout.blocks);
    EncodeJob job{codec, layout, voxels, prediction, choices, levels_for(voxels.type, execution)};
    if (codec.widths.kind == WidthRule::Kind::budget && units_for(job, codec.widths.value) < 0) {
        const double voxel_count =
            static_cast<double>(voxels.shape.z * voxels.shape.y * voxels.shape.x);
        return {Status::budget_too_small,
                {},
                codec.widths.value,
                8 * static_cast<double>(layout.payload_begin) / voxel_count};
    }
    examine(job, execution);
    choose(job);
    write_tables(job, code);
    job.code = reinterpret_cast<std::uint8_t*>(code.data());
    with_sample_type(voxels.type, [&]<class T>(T) {
        for_each_slab<T>(job, execution, fastest<write_slab<T>>(execution));
    });
    return {};
}

// ---- Many volumes ----------------------------------------------------------------------------

struct SlopeFinder::State {
    VariableS3dc codec;
    SampleType type;
    double voxels = 0, fixed_nbytes = 0;
    detail::SlopeHistogram histogram;
};

SlopeFinder::SlopeFinder(const VariableS3dc& codec, SampleType type)
    : state_(new State{codec, type, 0, 0, {}}) {
    state_->codec.widths = {WidthRule::Kind::slope, 1};
}

SlopeFinder::~SlopeFinder() = default;

Outcome SlopeFinder::add(const ConstVolume& voxels, const ConstVolume* prediction,
                         Execution execution) {
    using namespace detail;
    VariableLayout layout;
    const Outcome checked = check_job(state_->codec, voxels, prediction, layout);
    if (checked.status != Status::ok) return checked;
    Choices choices(layout.blocks);
    const EncodeJob job{state_->codec, layout,  voxels,
                        prediction,    choices, levels_for(voxels.type, execution)};
    examine(job, execution);
    const double unit_nbits = static_cast<double>(layout.unit_nbytes) * 8;
    std::array<HullStep, kWidths> hull;
    for (const BlockCurve& curve : choices.curves) {
        const std::size_t n = hull_of(curve, raw_units(state_->type), hull);
        for (std::size_t i = 0; i < n; ++i) {
            state_->histogram.add(hull[i].slope / unit_nbits, hull[i].units * unit_nbits);
        }
    }
    state_->voxels += static_cast<double>(voxels.shape.z * voxels.shape.y * voxels.shape.x);
    state_->fixed_nbytes += static_cast<double>(layout.payload_begin);
    return {};
}

double SlopeFinder::slope(double bits_per_voxel) const {
    return state_->histogram.least_slope(bits_per_voxel * state_->voxels -
                                         8 * state_->fixed_nbytes);
}

}  // namespace octobrick::codec
