#include "s3dc_variable_check.h"

#include <cstring>

#include "end_points.h"
#include "rows.h"

namespace octobrick::codec::detail {
namespace {

// Whether the voxels of an uncoded block, as many as the volume has of it, are within end points.
template <class T>
bool raw_within(const std::uint8_t* from, Zyx block, Zyx extent, T min, T max) {
    bool within = true;
    for (std::size_t z = 0; z < extent.z; ++z) {
        for (std::size_t y = 0; y < extent.y; ++y) {
            const std::uint8_t* row = from + (z * block.y + y) * block.x * sizeof(T);
            for (std::size_t x = 0; x < extent.x; ++x) {
                T voxel;
                std::memcpy(&voxel, row + x * sizeof(T), sizeof voxel);
                within &= voxel >= min && voxel <= max;  // false for NaN
            }
        }
    }
    return within;
}

// In the order of blocks, as decode_variable has it, so that of several faults the same is found.
template <class T>
Outcome check_blocks(const VariableLayout& layout, const Tables& tables, Zyx shape) {
    Zyx at;
    for (std::size_t block = 0; block < layout.blocks; ++block) {
        const EndPoints<T> ends(tables.end_points(block), false);
        if (!ends.plausible()) {
            return {Status::bad_end_points, at, ends.min_number(), ends.max_number()};
        }
        if (tables.width(block) == kRaw &&
            !raw_within<T>(tables.payload(block), layout.block, extent_of(at, layout.block, shape),
                           ends.template min<T>(), ends.template max<T>())) {
            return {Status::bad_raw, at, 0, 0};
        }
        if (++at.x < layout.grid.x) continue;
        at.x = 0;
        if (++at.y < layout.grid.y) continue;
        at.y = 0;
        ++at.z;
    }
    return {};
}

}  // namespace

Outcome check_variable_code(const VariableLayout& layout, SampleType type, Zyx shape,
                            std::span<const std::byte> code) {
    const Outcome outcome = check_tables(layout, code, type);
    if (outcome.status != Status::ok) return outcome;
    const Tables tables(layout, reinterpret_cast<const std::uint8_t*>(code.data()), type);
    return with_sample_type(type,
                            [&]<class T>(T) { return check_blocks<T>(layout, tables, shape); });
}

}  // namespace octobrick::codec::detail
