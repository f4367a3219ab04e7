// Encoding one block of a variable-rate code: what its widths cost, and then its bytes.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "block_voxels.h"
#include "level_fit.h"
#include "octobrick/codec/s3dc_variable.h"
#include "rows.h"
#include "s3dc_variable_format.h"
#include "wide_indices.h"
#include "width_choice.h"

namespace octobrick::codec::detail {

using Kind = WidthRule::Kind;

// What is decided for a block before its bytes are written.
struct Choices {
    explicit Choices(std::size_t blocks) : widths(blocks), predicted(blocks) {}
    std::vector<std::uint8_t> widths;
    std::vector<std::uint8_t> predicted;  // 0 or 1
    std::vector<BlockCurve> curves;       // for a budget or a slope
};

struct EncodeJob {
    const VariableS3dc& codec;
    const VariableLayout& layout;
    ConstVolume voxels;
    const ConstVolume* prediction;
    Choices& choices;
    FindLevels find_levels;
    std::uint8_t* code = nullptr;
};

// What one thread needs.
template <class T>
struct EncodeScratch {
    explicit EncodeScratch(const EncodeJob& job)
        : rows(job.voxels, job.layout.block),
          prediction_rows(job.prediction != nullptr ? *job.prediction : ConstVolume{},
                          job.prediction != nullptr ? job.layout.block : Zyx{}),
          block(job.layout.block.z * job.layout.block.y * job.layout.block.x),
          indices(block_indices(job.layout)),
          compact(block_indices(job.layout)) {}

    static std::size_t block_indices(const VariableLayout& layout) {
        return (layout.unit_nbytes * 8 + kChunk - 1) / kChunk * kChunk;
    }

    SlabRows<T, ConstVolume> rows, prediction_rows;
    BlockVoxels<T> block;
    Array<std::uint16_t> indices;  // of the whole block, as they are stored
    Array<std::uint16_t> compact;  // of the voxels that it has
};

// End points of a block, and whether they are of differences.
template <class T>
struct Ends {
    Work<T> first, last;
};

// End points for a width: of fitted levels, or least and greatest.
template <class T>
OCTOBRICK_INLINE Ends<T> ends_for(FindLevels find_levels, BlockVoxels<T>& block, bool as_difference,
                                  unsigned width, bool fitted, const Range<T>& range) {
    if (range.constant() || width == kRaw)
        return {range.end_point(0), range.end_point(range.reach())};
    const Levels levels = find_block_levels<T>(find_levels, block, as_difference, range, width,
                                               fitted && width <= kMostFitted);
    return {range.end_point(levels.first), range.end_point(levels.last)};
}

// The end points with which evenly spread voxels are least far off; least and greatest where that
// makes integers exact.
template <class T>
Ends<T> even_ends(const Range<T>& range, unsigned width) {
    if constexpr (std::is_integral_v<T>) {
        const int levels = 1 << width, reach = range.max - range.min;
        if (reach < levels) return {range.min, range.max};
        const int margin = (reach + 1) / (2 * levels);
        return width == 0 ? Ends<T>{range.min + margin, range.min + margin}
                          : Ends<T>{range.min + margin, range.max - margin};
    } else {
        const float margin = even_margin(width, range.reach());
        return {range.end_point(margin),
                range.end_point(width == 0 ? margin : range.reach() - margin)};
    }
}

// The greatest error of a block with these end points and indices.
template <class T>
double greatest_error(const BlockVoxels<T>& block, bool as_difference, const Ends<T>& ends,
                      unsigned width, const std::uint16_t* indices) {
    double greatest = 0;
    for (std::size_t i = 0; i < block.n; ++i) {
        const Work<T> level = value_at(ends.first, ends.last, width, indices[i]);
        double off;
        if constexpr (std::is_integral_v<T>) {
            off = std::abs(block.coded(as_difference)[i] - level);
        } else {
            const float decoded =
                as_difference ? predicted_plus<float>(block.prediction[i], level) : level;
            off = std::fabs(static_cast<double>(decoded) - static_cast<double>(block.values[i]));
        }
        greatest = std::max(greatest, off);
    }
    return greatest;
}

// The least width that keeps a bound; kRaw where none does.
template <class T>
unsigned least_width(const EncodeJob& job, EncodeScratch<T>& scratch, bool as_difference,
                     const Range<T>& range) {
    const BlockVoxels<T>& block = scratch.block;
    const double bound = job.codec.widths.value;
    const double reach = static_cast<double>(range.max) - static_cast<double>(range.min);
    const unsigned most = most_width(job.voxels.type);
    // The first width worth a try: half a step of 2^width levels is below the bound and a rounding.
    unsigned width = 0;
    while (width < most &&
           std::ldexp(reach, -static_cast<int>(width) - 1) > bound + 0.5 * std::is_integral_v<T>) {
        ++width;
    }
    for (; width <= most; ++width) {
        const Ends<T> ends = even_ends(range, width);
        find_indices(block.coded(as_difference), block.n, ends.first, ends.last, width,
                     scratch.compact.data());
        if (greatest_error(block, as_difference, ends, width, scratch.compact.data()) <= bound) {
            return width;
        }
    }
    return kRaw;
}

template <class T>
OCTOBRICK_INLINE void add_curve(const EncodeJob& job, EncodeScratch<T>& scratch, bool as_difference,
                                const Range<T>& range, BlockCurve& curve) {
    constexpr bool kInteger = std::is_integral_v<T>;
    BlockVoxels<T>& block = scratch.block;
    range.normalise(block.coded(as_difference), block.n, block.normalised.data());
    const double unit = range.unit() * range.unit();
    double fine = 0;  // the squared error at kMostFitted
    for (unsigned width = 0; width <= most_width(job.voxels.type); ++width) {
        double squares = 0;
        const float levels = static_cast<float>((1u << width) - 1);
        if (kInteger && levels >= range.reach()) {
            // exact
        } else if (width > kMostFitted && 2 * levels <= range.reach()) {
            squares = fine_squares<kInteger>(fine, kMostFitted, width, range.reach());
        } else {
            squares = unit * job.find_levels(block.normalised.data(), block.n, range.reach(), width,
                                             job.codec.fitted && width <= kMostFitted)
                                 .squares;
            if (width == kMostFitted) fine = squares;
        }
        if (squares < curve.squares[width]) {
            curve.squares[width] = squares;
            curve.predicted = static_cast<std::uint16_t>((curve.predicted & ~(1u << width)) |
                                                         unsigned{as_difference} << width);
        }
        if (squares == 0) return;  // more bits gain nothing
    }
    // Only voxels themselves can be copied. What is left of 14-bit floats is hardly worth it.
    if (sample_nbytes(job.voxels.type) > 1) curve.squares[kRaw] = 0;
}

// Decides a block's width and mode, or finds what its widths cost in error.
template <class T>
OCTOBRICK_INLINE void examine_block(const EncodeJob& job, EncodeScratch<T>& scratch,
                                    std::size_t at) {
    BlockVoxels<T>& block = scratch.block;
    const Range<T> direct = Range<T>::of(block.values.data(), block.n);
    Range<T> difference{};
    bool predictable = false;
    if (job.prediction != nullptr) {
        difference = Range<T>::of(block.differences.data(), block.n);
        predictable = difference.holds_differences();
    }
    const auto narrower = [&] {
        return predictable &&
               static_cast<double>(difference.max) - static_cast<double>(difference.min) <
                   static_cast<double>(direct.max) - static_cast<double>(direct.min);
    };
    switch (job.codec.widths.kind) {
        case Kind::same:
            job.choices.widths[at] = static_cast<std::uint8_t>(job.codec.widths.value);
            job.choices.predicted[at] = narrower();
            return;
        case Kind::bound: {
            unsigned width = least_width(job, scratch, false, direct);
            if (narrower()) {
                const unsigned other = least_width(job, scratch, true, difference);
                job.choices.predicted[at] = other < width;
                width = std::min(width, other);
            }
            job.choices.widths[at] = static_cast<std::uint8_t>(width);
            return;
        }
        case Kind::budget:
        case Kind::slope: break;
    }
    BlockCurve& curve = job.choices.curves[at];
    curve.squares.fill(std::numeric_limits<double>::infinity());
    add_curve(job, scratch, false, direct, curve);
    if (predictable) add_curve(job, scratch, true, difference, curve);
}

// Writes end points, and indices or voxels.
template <class T>
OCTOBRICK_INLINE void write_block(const EncodeJob& job, EncodeScratch<T>& scratch, std::size_t at,
                                  std::uint8_t* payload) {
    BlockVoxels<T>& block = scratch.block;
    const unsigned width = job.choices.widths[at];
    const bool as_difference = job.choices.predicted[at] != 0;
    const Work<T>* coded = block.coded(as_difference);
    const Range<T> range = Range<T>::of(coded, block.n);
    const Ends<T> ends =
        job.codec.widths.kind == Kind::bound && width != kRaw
            ? even_ends(range, width)
            : ends_for(job.find_levels, block, as_difference, width, job.codec.fitted, range);
    std::uint8_t* to = job.code + 2 * sizeof(T) * at;
    if (as_difference) {
        store_ends<Difference<T>>(ends.first, ends.last, to);
    } else {
        store_ends<T>(ends.first, ends.last, to);
    }
    const Zyx whole = job.layout.block;
    if (width == kRaw) {
        for_each_voxel(block.extent, whole, [&](std::size_t i, std::size_t in_whole) {
            const T voxel = static_cast<T>(block.values[i]);
            std::memcpy(payload + sizeof(T) * in_whole, &voxel, sizeof(T));
        });
        return;
    }
    if (width == 0) return;
    if (block.extent == whole) {
        find_indices(coded, block.n, ends.first, ends.last, width, scratch.indices.data());
        std::fill(&scratch.indices[block.n], scratch.indices.data() + job.layout.unit_nbytes * 8,
                  0);
    } else {
        find_indices(coded, block.n, ends.first, ends.last, width, scratch.compact.data());
        std::fill_n(scratch.indices.data(), job.layout.unit_nbytes * 8, 0);
        for_each_voxel(block.extent, whole, [&](std::size_t i, std::size_t in_whole) {
            scratch.indices[in_whole] = scratch.compact[i];
        });
    }
    pack_indices(scratch.indices.data(), job.layout.unit_nbytes * 8, width, payload);
}

}  // namespace octobrick::codec::detail
