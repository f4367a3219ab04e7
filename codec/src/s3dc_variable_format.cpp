#include "s3dc_variable_format.h"

#include <algorithm>

#include "faults.h"

namespace octobrick::codec {

namespace {

std::size_t ceil_div(std::size_t a, std::size_t b) { return a / b + (a % b != 0); }
std::size_t whole_words(std::size_t nbytes) { return 4 * ceil_div(nbytes, 4); }

}  // namespace

Status make_variable_layout(Zyx block, SampleType type, Zyx shape, bool predicted,
                            VariableLayout& layout) noexcept {
    using namespace detail;
    Layout fixed;  // of one bit: the same grid and end points, and no more bytes than raw voxels
    if (const Status s = make_layout({block, 1}, type, shape, fixed); s != Status::ok) return s;
    layout.block = {std::min(block.z, shape.z), std::min(block.y, shape.y),
                    std::min(block.x, shape.x)};
    layout.grid = fixed.grid;
    layout.blocks = fixed.grid.z * fixed.grid.y * fixed.grid.x;
    const std::size_t block_voxels = layout.block.z * layout.block.y * layout.block.x;
    layout.unit_nbytes = 4 * ceil_div(block_voxels, kIndicesPerUnit);
    const std::size_t groups = ceil_div(layout.blocks, kGroup);
    layout.groups_begin = whole_words(fixed.end_points_nbytes);
    layout.flags_begin = layout.groups_begin + kGroup_nbytes * groups;
    layout.payload_begin = layout.flags_begin + (predicted ? whole_words(groups) : 0);

    // The largest code, all blocks raw, and the first units of its groups.
    std::size_t raw_nbytes, units;
    const bool fits = checked_mul(layout.blocks, 8 * sample_nbytes(type), units) &&
                      units <= UINT32_MAX && checked_mul(units, layout.unit_nbytes, raw_nbytes) &&
                      raw_nbytes <= PTRDIFF_MAX - layout.payload_begin;
    return fits ? Status::ok : Status::too_large;
}

namespace detail {

Outcome check_tables(const VariableLayout& layout, std::span<const std::byte> code,
                     SampleType type) noexcept {
    if (code.size() < layout.payload_begin) {
        return {Status::wrong_nbytes,
                {},
                static_cast<double>(layout.payload_begin),
                static_cast<double>(code.size())};
    }
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(code.data());
    const Tables tables(layout, bytes, type);
    std::uint64_t units = 0;  // at most 2^32: blocks times bits of a sample were checked
    for (std::size_t block = 0; block < layout.blocks; block += kGroup) {
        const Outcome bad = {Status::bad_groups, place_of(block, layout.grid), 0, 0};
        if (tables.group_first(block / kGroup) != units) return bad;
        const std::size_t here = std::min(kGroup, layout.blocks - block);
        const std::uint32_t widths = tables.group_widths(block / kGroup);
        if (here < kGroup && widths >> 4 * here != 0) return bad;
        for (std::size_t i = 0; i < here; ++i) {
            const unsigned width = widths >> 4 * i & 15;
            const bool raw = width == kRaw && sample_nbytes(type) > 1;
            if (width > most_width(type) && !raw) return bad;
            if (raw && tables.predicted(block + i)) return bad;
            units += units_of(width, type);
        }
        if (layout.flags_begin != layout.payload_begin && here < kGroup &&
            bytes[layout.flags_begin + block / kGroup] >> here != 0) {
            return bad;
        }
    }
    const std::uint64_t nbytes = layout.payload_begin + units * layout.unit_nbytes;
    if (code.size() != nbytes) {
        return {Status::wrong_nbytes,
                {},
                static_cast<double>(nbytes),
                static_cast<double>(code.size())};
    }
    return {};
}

Outcome check_prediction(const ConstVolume* prediction, SampleType type, Zyx shape) {
    if (prediction == nullptr) return {};
    if (prediction->type != type || prediction->shape != shape) {
        return {Status::wrong_prediction, {}, 0, 0};
    }
    return type == SampleType::f32 ? find_not_finite(*prediction) : Outcome{};
}

}  // namespace detail
}  // namespace octobrick::codec
