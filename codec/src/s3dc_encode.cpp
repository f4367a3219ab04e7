#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "block_voxels.h"
#include "faults.h"
#include "index_rows.h"
#include "level_fit.h"
#include "octobrick/codec/s3dc.h"
#include "parallel.h"
#include "quantise.h"
#include "rows.h"
#include "s3dc_scaled.h"

namespace octobrick::codec {
namespace detail {
namespace {

struct EncodeJob {
    ConstVolume voxels;
    Zyx block;
    unsigned bits;
    FindLevels find_levels;  // null: end points are least and greatest
    Layout layout;
    std::uint8_t* code;
    FirstFault* fault;
};

// What one thread needs for one slab.
template <class T>
struct EncodeScratch {
    EncodeScratch(const ConstVolume& v, Zyx fitted_block)
        : reader(v),
          min(v.shape.x),
          max(v.shape.x),
          quantiser(v.shape.x),
          rows(v, fitted_block),
          block(fitted_block.z * fitted_block.y * fitted_block.x),
          clamped(fitted_block.x > 0 ? v.shape.x : 0) {}
    RowReader<T> reader;
    Array<T> min, max;  // of each column, then the end points of its block
    QuantiserFor<T> quantiser;
    // For fitting only.
    SlabRows<T, ConstVolume> rows;
    BlockVoxels<T> block;
    Array<T> clamped;
};

// Step 1: the least and greatest sample of every column (x) of a slab's rows. False where a
// sample is not finite; min and max then mean nothing.
template <class T>
OCTOBRICK_INLINE bool column_ranges(const RowReader<T>& reader, Zyx begin, Zyx end,
                                    T* __restrict min, T* __restrict max) {
    const std::size_t nx = end.x;
    std::fill_n(min, nx, std::numeric_limits<T>::max());
    std::fill_n(max, nx, std::numeric_limits<T>::lowest());
    bool all_finite = true;
    for (std::size_t z = begin.z; z < end.z; ++z) {
        for (std::size_t y = begin.y; y < end.y; ++y) {
            const T* __restrict row = reader.row(z, y);
            for (std::size_t x = 0; x < nx; ++x) {
                min[x] = row[x] < min[x] ? row[x] : min[x];
                max[x] = row[x] > max[x] ? row[x] : max[x];
            }
            if constexpr (std::is_floating_point_v<T>) {
                int infinite = 0;
                for (std::size_t x = 0; x < nx; ++x) {
                    infinite |= !(std::fabs(row[x]) <= std::numeric_limits<T>::max());
                }
                all_finite &= infinite == 0;
            }
        }
    }
    return all_finite;
}

// Step 2: columns to blocks. Writes the end points, and sets the quantiser of every column.
template <class T>
OCTOBRICK_INLINE void write_end_points(const EncodeJob& job, EncodeScratch<T>& scratch, Zyx begin,
                                       Zyx end, std::uint8_t* to) {
    const unsigned last_index = (1u << job.bits) - 1;
    if (job.find_levels != nullptr) scratch.rows.open(begin, end);
    for (std::size_t x = 0, to_x; x < end.x; x = to_x, to += 2 * sizeof(T)) {
        to_x = x + std::min(job.block.x, end.x - x);
        T ends[2] = {*std::min_element(&scratch.min[x], scratch.min.data() + to_x),
                     *std::max_element(&scratch.max[x], scratch.max.data() + to_x)};
        if (job.find_levels != nullptr) {
            scratch.block.gather(scratch.rows, x, {end.z - begin.z, end.y - begin.y, to_x - x});
            const Range<T> range{ends[0], ends[1]};
            const Levels levels =
                find_block_levels<T>(job.find_levels, scratch.block, false, range, job.bits, true);
            ends[0] = static_cast<T>(range.end_point(levels.first));
            ends[1] = static_cast<T>(range.end_point(levels.last));
            std::fill(&scratch.min[x], scratch.min.data() + to_x, ends[0]);
            std::fill(&scratch.max[x], scratch.max.data() + to_x, ends[1]);
        }
        if constexpr (std::is_floating_point_v<T>) {
            for (T& e : ends) {
                e += T{0};  // −0 becomes +0: which zero is "less" must not depend on the order
            }
        }
        std::memcpy(to, ends, sizeof ends);
        scratch.quantiser.set(x, to_x, ends[0], ends[1], last_index);
    }
}

// Fitted end points lie within the block's range, so voxels can lie outside of them.
template <class T>
OCTOBRICK_INLINE const T* clamp_row(const EncodeScratch<T>& scratch, const T* row, std::size_t nx) {
    const T* min = scratch.min.data();
    const T* max = scratch.max.data();
    for (std::size_t x = 0; x < nx; ++x) {
        const T above = row[x] < min[x] ? min[x] : row[x];
        scratch.clamped[x] = above > max[x] ? max[x] : above;
    }
    return scratch.clamped.data();
}

// Step 3: one row of voxels to one row of packed indices.
template <class T, unsigned B>
OCTOBRICK_INLINE void write_row(const EncodeScratch<T>& scratch, const T* row, std::size_t nx,
                                std::uint8_t* to, std::size_t row_nbytes) {
    constexpr unsigned kLevels = (1u << B) - 1;
    std::size_t x = 0;
    for (; x + kChunk <= nx; x += kChunk) {
        std::uint8_t indices[kChunk];
        scratch.quantiser.quantise(row, x, kChunk, kLevels, indices);
        pack_chunk<B>(indices, to + x * B / 8);
    }
    if (x < nx) {
        std::uint8_t indices[kChunk] = {};
        scratch.quantiser.quantise(row, x, nx - x, kLevels, indices);
        pack_tail<B>(indices, to + x * B / 8, row_nbytes - x * B / 8);
    }
}

// A slab is one (z, y) line of blocks over the whole length of x.
template <class T, unsigned B>
OCTOBRICK_INLINE void encode_slab(const EncodeJob& job, EncodeScratch<T>& scratch,
                                  std::size_t slab) {
    const Zyx shape = job.voxels.shape;
    const Zyx begin = {slab / job.layout.grid.y * job.block.z,
                       slab % job.layout.grid.y * job.block.y, 0};
    const Zyx end = {begin.z + std::min(job.block.z, shape.z - begin.z),
                     begin.y + std::min(job.block.y, shape.y - begin.y), shape.x};

    if (!column_ranges(scratch.reader, begin, end, scratch.min.data(), scratch.max.data())) {
        job.fault->report(slab, {Status::not_finite, {}, 0, 0});
        return;
    }
    write_end_points(job, scratch, begin, end, job.code + slab * job.layout.grid.x * 2 * sizeof(T));

    for (std::size_t z = begin.z; z < end.z; ++z) {
        for (std::size_t y = begin.y; y < end.y; ++y) {
            const T* row = scratch.reader.row(z, y);
            if (job.find_levels != nullptr) row = clamp_row(scratch, row, shape.x);
            write_row<T, B>(
                scratch, row, shape.x,
                job.code + job.layout.end_points_nbytes + (z * shape.y + y) * job.layout.row_nbytes,
                job.layout.row_nbytes);
        }
    }
}

template <class T>
using EncodeSlab = void (*)(const EncodeJob&, EncodeScratch<T>&, std::size_t);

template <class T, unsigned... B>
EncodeSlab<T> choose_encoder(unsigned bits, Execution execution,
                             std::integer_sequence<unsigned, B...>) {
    constexpr bool kAvx512Pays = sizeof(T) > 1;  // see simd.h for what was measured
    const EncodeSlab<T> encoders[] = {fastest<encode_slab<T, B + 1>, kAvx512Pays>(execution)...};
    return encoders[bits - 1];
}

// No larger than the volume.
Zyx whole_block(const EncodeJob& job) {
    const Zyx shape = job.voxels.shape;
    return {std::min(job.block.z, shape.z), std::min(job.block.y, shape.y),
            std::min(job.block.x, shape.x)};
}

template <class T>
void run_encode(const EncodeJob& job, Execution execution) {
    const std::size_t slabs = job.layout.grid.z * job.layout.grid.y;
    const std::size_t nbytes =
        job.voxels.shape.z * job.voxels.shape.y * job.voxels.shape.x * sizeof(T);
    const unsigned threads = choose_threads(execution.threads, nbytes, slabs);
    const EncodeSlab<T> encode_slab =
        choose_encoder<T>(job.bits, execution, std::make_integer_sequence<unsigned, 8>{});

    std::vector<EncodeScratch<T>> scratch;
    scratch.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) {
        scratch.emplace_back(job.voxels, job.find_levels != nullptr ? whole_block(job) : Zyx{});
    }
    parallel_for(slabs, threads, [&](std::size_t slab, unsigned worker) {
        encode_slab(job, scratch[worker], slab);
    });
}

}  // namespace
}  // namespace detail

Outcome encode(const S3dc& codec, const ConstVolume& voxels, std::span<std::byte> code,
               Execution execution) {
    Layout layout;
    if (const Status s = make_layout(codec, voxels.type, voxels.shape, layout); s != Status::ok) {
        return {s, {}, 0, 0};
    }
    if (code.size() != layout.nbytes) {
        return {Status::wrong_nbytes, {}, 0, 0};
    }
    auto* bytes = reinterpret_cast<std::uint8_t*>(code.data());
    if (codec.scaled) return detail::encode_scaled(codec, voxels, layout, bytes, execution);
    detail::FirstFault fault;
    const detail::FindLevels fit =
        codec.fitted ? detail::find_levels_for(voxels.type != SampleType::f32, execution) : nullptr;
    const detail::EncodeJob job{voxels, codec.block, codec.bits, fit, layout, bytes, &fault};
    detail::with_sample_type(voxels.type,
                             [&]<class T>(T) { detail::run_encode<T>(job, execution); });
    if (fault.outcome().status == Status::not_finite) {
        const Outcome first = detail::find_not_finite(voxels);  // in memory order, not slab by slab
        // There is none any more if someone changed the voxels meanwhile.
        return first.status != Status::ok ? first : Outcome{Status::not_finite, {}, 0, 0};
    }
    return {};
}

}  // namespace octobrick::codec
