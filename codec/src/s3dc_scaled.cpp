#include "s3dc_scaled.h"

#include <algorithm>
#include <cstring>
#include <vector>

#include "block_voxels.h"
#include "end_points.h"
#include "faults.h"
#include "index_rows.h"
#include "parallel.h"
#include "rows.h"
#include "s3dc_variable_format.h"
#include "scales.h"

namespace octobrick::codec::detail {
namespace {

// ---- The parts of a code ---------------------------------------------------------------------

struct Scaled {
    Zyx block;  // no larger than the volume
    unsigned bits;
    const Layout& layout;
    Scales scales;

    std::size_t choices_begin() const { return layout.scales_begin + scales_nbytes(bits); }
};

Scaled make_scaled(const S3dc& codec, const Layout& layout, Zyx shape, const Scales& scales) {
    return {{std::min(codec.block.z, shape.z), std::min(codec.block.y, shape.y),
             std::min(codec.block.x, shape.x)},
            codec.bits,
            layout,
            scales};
}

// The rows of block line `slab`: those of [begin, end) in z and y.
struct Line {
    Line(const Scaled& scaled, Zyx shape, std::size_t slab)
        : first_block(slab * scaled.layout.grid.x),
          place(place_of(first_block, scaled.layout.grid)),
          begin{place.z * scaled.block.z, place.y * scaled.block.y, 0},
          extent(extent_of(place, scaled.block, shape)),
          end{begin.z + extent.z, begin.y + extent.y, shape.x} {}
    std::size_t first_block;
    Zyx place, begin, extent, end;
};

// Values of the indices of a block: from the first end point to the last, and never back.
template <class T>
void fill_palette(const Scaled& scaled, unsigned scale, T min, T max, T* palette) {
    const std::size_t indices = std::size_t{1} << scaled.bits;
    for (std::size_t i = 0; i < indices; ++i) {
        const std::uint32_t position = scaled.scales[scale][i];
        if constexpr (std::is_floating_point_v<T>) {
            const double range = static_cast<double>(max) - static_cast<double>(min);
            const auto value = static_cast<float>(
                static_cast<double>(min) + range * position / static_cast<double>(kScaleTop));
            palette[i] = position == kScaleTop ? max : std::clamp(value, min, max);
        } else {  // at most 65535² + 32767 < 2^32
            const auto range = static_cast<std::uint32_t>(max - min);
            palette[i] = static_cast<T>(
                min + static_cast<std::int32_t>((range * position + kScaleTop / 2) / kScaleTop));
        }
    }
}

template <unsigned B>
void pack_row(const std::uint8_t* indices, std::size_t nx, std::uint8_t* to, std::size_t nbytes) {
    for (std::size_t x = 0; x < nx; x += kChunk) {
        pack_tail<B>(indices + x, to + x * B / 8, std::min<std::size_t>(8 * B, nbytes - x * B / 8));
    }
}
template <unsigned B>
void unpack_row(const std::uint8_t* from, std::size_t nbytes, std::size_t nx,
                std::uint8_t* indices) {
    for (std::size_t x = 0; x < nx; x += kChunk) {
        unpack_tail<B>(from + x * B / 8, indices + x,
                       std::min<std::size_t>(8 * B, nbytes - x * B / 8));
    }
}

template <class F>
void with_bits(unsigned bits, const F& f) {
    switch (bits) {
        case 1: return f.template operator()<1>();
        case 2: return f.template operator()<2>();
        case 3: return f.template operator()<3>();
        case 4: return f.template operator()<4>();
        case 5: return f.template operator()<5>();
        case 6: return f.template operator()<6>();
        case 7: return f.template operator()<7>();
        case 8: return f.template operator()<8>();
    }
}

std::size_t whole_chunks(std::size_t nx) { return (nx + kChunk - 1) / kChunk * kChunk; }

// ---- Encoding --------------------------------------------------------------------------------

template <class T>
struct EncodeScratch {
    EncodeScratch(const ConstVolume& v, Zyx block)
        : rows(v, block),
          voxels(block.z * block.y * block.x),
          positions(block.z * block.y * block.x),
          indices(block.z * block.y * whole_chunks(v.shape.x)) {}
    SlabRows<T, ConstVolume> rows;
    BlockVoxels<T> voxels;
    Array<std::uint16_t> positions;
    Array<std::uint8_t> indices;  // of the line's rows, each in whole chunks
};

// The index whose value is nearest, the lower of two: `palette` does not fall.
template <class T>
std::uint8_t nearest_in(const T* palette, std::size_t indices, T value) {
    const T* above = std::lower_bound(palette, palette + indices - 1, value);
    if (above == palette) return 0;
    const double to_above = static_cast<double>(*above) - static_cast<double>(value);
    const double to_below = static_cast<double>(value) - static_cast<double>(above[-1]);
    // Of several indices with one value the first.
    const T* nearest = to_above < to_below ? above : std::lower_bound(palette, above, above[-1]);
    return static_cast<std::uint8_t>(nearest - palette);
}

template <class T>
void encode_line(const Scaled& scaled, const ScaleChooser& chooser, const ConstVolume& voxels,
                 EncodeScratch<T>& scratch, std::size_t slab, std::uint8_t* code,
                 std::uint8_t* choices) {
    const Line line(scaled, voxels.shape, slab);
    const std::size_t stride = whole_chunks(voxels.shape.x);
    scratch.rows.open(line.begin, line.end);
    for (std::size_t i = 0; i < scaled.layout.grid.x; ++i) {
        const Zyx extent = extent_of({line.place.z, line.place.y, i}, scaled.block, voxels.shape);
        const std::size_t x = i * scaled.block.x;
        BlockVoxels<T>& block = scratch.voxels;
        block.gather(scratch.rows, x, extent);
        const Range<T> range = Range<T>::of(block.values.data(), block.n);
        const T ends[2] = {static_cast<T>(range.end_point(0)),
                           static_cast<T>(range.end_point(range.reach()))};
        std::memcpy(code + 2 * sizeof(T) * (line.first_block + i), ends, sizeof ends);
        unsigned scale = 0;
        if (!range.constant()) {
            for (std::size_t k = 0; k < block.n; ++k) {
                scratch.positions[k] = position_of<T>(block.values[k], range);
            }
            scale = chooser.best(scratch.positions.data(), block.n);
        }
        choices[line.first_block + i] = static_cast<std::uint8_t>(scale);
        T palette[kMostIndices];
        fill_palette(scaled, scale, ends[0], ends[1], palette);
        std::size_t k = 0;
        for (std::size_t row = 0; row < extent.z * extent.y; ++row) {
            for (std::size_t at = x; at < x + extent.x; ++at, ++k) {
                scratch.indices[row * stride + at] = nearest_in(
                    palette, std::size_t{1} << scaled.bits, static_cast<T>(block.values[k]));
            }
        }
    }
    for (std::size_t row = 0; row < line.extent.z * line.extent.y; ++row) {
        const std::size_t z = line.begin.z + row / line.extent.y;
        const std::size_t y = line.begin.y + row % line.extent.y;
        with_bits(scaled.bits, [&]<unsigned B>() {
            pack_row<B>(scratch.indices.data() + row * stride, voxels.shape.x,
                        code + scaled.layout.end_points_nbytes +
                            (z * voxels.shape.y + y) * scaled.layout.row_nbytes,
                        scaled.layout.row_nbytes);
        });
    }
}

template <class T>
void run_encode(const Scaled& scaled, const ConstVolume& voxels, std::uint8_t* code,
                Execution execution) {
    const std::size_t slabs = scaled.layout.grid.z * scaled.layout.grid.y;
    const std::size_t nbytes = voxels.shape.z * voxels.shape.y * voxels.shape.x * sizeof(T);
    const unsigned threads = choose_threads(execution.threads, nbytes, slabs);
    const ScaleChooser chooser(scaled.scales, scaled.bits);
    std::vector<EncodeScratch<T>> scratch;
    scratch.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) scratch.emplace_back(voxels, scaled.block);
    // A byte per block first: threads must not share the bytes that hold two.
    std::vector<std::uint8_t> choices(slabs * scaled.layout.grid.x);
    parallel_for(slabs, threads, [&](std::size_t slab, unsigned worker) {
        encode_line(scaled, chooser, voxels, scratch[worker], slab, code, choices.data());
    });
    std::uint8_t* to = code + scaled.choices_begin();
    for (std::size_t i = 0; i < choices.size(); i += 2) {
        const unsigned second = i + 1 < choices.size() ? choices[i + 1] : 0;
        *to++ = static_cast<std::uint8_t>(choices[i] | second << 4);
    }
}

// ---- Decoding --------------------------------------------------------------------------------

template <class T>
struct DecodeScratch {
    DecodeScratch(const Volume& v, const Scaled& scaled)
        : writer(v),
          palettes(scaled.layout.grid.x << scaled.bits),
          indices(whole_chunks(v.shape.x)) {}
    RowWriter<T> writer;
    Array<T> palettes;
    Array<std::uint8_t> indices;
};

template <class T>
Outcome decode_line(const Scaled& scaled, const std::uint8_t* code, const Volume& voxels,
                    DecodeScratch<T>& scratch, std::size_t slab) {
    const Line line(scaled, voxels.shape, slab);
    const std::size_t nx = voxels.shape.x;
    for (std::size_t i = 0; i < scaled.layout.grid.x; ++i) {
        const std::size_t block = line.first_block + i;
        const EndPoints<T> ends(code + 2 * sizeof(T) * block, false);
        const Zyx place = {line.place.z, line.place.y, i};
        if (!ends.plausible()) {
            return {Status::bad_end_points, place, ends.min_number(), ends.max_number()};
        }
        const unsigned scale = code[scaled.choices_begin() + block / 2] >> 4 * (block % 2) & 15;
        if (scale >= kScales) return {Status::bad_scales, place, 0, 0};
        fill_palette(scaled, scale, ends.template min<T>(), ends.template max<T>(),
                     scratch.palettes.data() + (i << scaled.bits));
    }
    for (std::size_t z = line.begin.z; z < line.end.z; ++z) {
        for (std::size_t y = line.begin.y; y < line.end.y; ++y) {
            const std::uint8_t* from = code + scaled.layout.end_points_nbytes +
                                       (z * voxels.shape.y + y) * scaled.layout.row_nbytes;
            with_bits(scaled.bits, [&]<unsigned B>() {
                unpack_row<B>(from, scaled.layout.row_nbytes, nx, scratch.indices.data());
            });
            const std::uint8_t* behind = scratch.indices.data() + nx;
            const std::uint8_t* end = scratch.indices.data() + whole_chunks(nx);
            if (std::any_of(behind, end, [](std::uint8_t index) { return index != 0; })) {
                return {Status::bad_padding, {z, y, 0}, 0, 0};
            }
            T* row = scratch.writer.row(z, y);
            const T* palette = scratch.palettes.data();
            for (std::size_t x = 0; x < nx; palette += std::size_t{1} << scaled.bits) {
                const std::size_t block_end = std::min(nx, x + scaled.block.x);
                for (; x < block_end; ++x) row[x] = palette[scratch.indices[x]];
            }
            scratch.writer.commit(z, y);
        }
    }
    return {};
}

template <class T>
Outcome run_decode(const Scaled& scaled, const std::uint8_t* code, const Volume& voxels,
                   Execution execution) {
    const std::size_t slabs = scaled.layout.grid.z * scaled.layout.grid.y;
    const std::size_t nbytes = voxels.shape.z * voxels.shape.y * voxels.shape.x * sizeof(T);
    const unsigned threads = choose_threads(execution.threads, nbytes, slabs);
    std::vector<DecodeScratch<T>> scratch;
    scratch.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) scratch.emplace_back(voxels, scaled);
    FirstFault fault;
    parallel_for(slabs, threads, [&](std::size_t slab, unsigned worker) {
        fault.report(slab, decode_line(scaled, code, voxels, scratch[worker], slab));
    });
    return fault.outcome();
}

// The positions of a code, which must not fall, from 0 to the top: so no value leaves a block's
// range, and the last index is its maximum.
bool read_scales(const std::uint8_t* from, unsigned bits, Scales& scales) {
    const std::size_t indices = std::size_t{1} << bits;
    for (auto& scale : scales) {
        std::memcpy(scale.data(), from, indices * sizeof scale[0]);
        from += indices * sizeof scale[0];
        if (scale[0] != 0 || scale[indices - 1] != kScaleTop ||
            !std::is_sorted(scale.begin(), scale.begin() + static_cast<std::ptrdiff_t>(indices))) {
            return false;
        }
    }
    return true;
}

}  // namespace

Outcome encode_scaled(const S3dc& codec, const ConstVolume& voxels, const Layout& layout,
                      std::uint8_t* code, Execution execution) {
    if (voxels.type == SampleType::f32) {
        if (const Outcome bad = find_not_finite(voxels); bad.status != Status::ok) return bad;
    }
    const Scaled scaled = make_scaled(codec, layout, voxels.shape, train_scales(codec, voxels));
    std::uint8_t* to = code + layout.scales_begin;
    const std::size_t nbytes = sizeof(std::uint16_t) << codec.bits;
    for (const auto& scale : scaled.scales) {
        std::memcpy(to, scale.data(), nbytes);
        to += nbytes;
    }
    with_sample_type(voxels.type,
                     [&]<class T>(T) { run_encode<T>(scaled, voxels, code, execution); });
    return {};
}

Outcome decode_scaled(const S3dc& codec, const std::uint8_t* code, const Layout& layout,
                      const Volume& voxels, Execution execution) {
    Scales scales{};
    if (!read_scales(code + layout.scales_begin, codec.bits, scales)) {
        return {Status::bad_scales, {}, 0, 0};
    }
    const Scaled scaled = make_scaled(codec, layout, voxels.shape, scales);
    const std::size_t blocks = layout.grid.z * layout.grid.y * layout.grid.x;
    if (blocks % 2 != 0 && code[layout.nbytes - 1] >> 4 != 0) return {Status::bad_scales, {}, 0, 0};
    return with_sample_type(
        voxels.type, [&]<class T>(T) { return run_decode<T>(scaled, code, voxels, execution); });
}

}  // namespace octobrick::codec::detail
