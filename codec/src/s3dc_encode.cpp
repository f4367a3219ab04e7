#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "faults.h"
#include "index_rows.h"
#include "octobrick/codec/s3dc.h"
#include "parallel.h"
#include "quantise.h"
#include "rows.h"

namespace octobrick::codec {
namespace detail {
namespace {

struct EncodeJob {
    ConstVolume voxels;
    Zyx block;
    unsigned bits;
    Layout layout;
    std::uint8_t* code;
    FirstFault* fault;
};

// What one thread needs for one slab.
template <class T>
struct EncodeScratch {
    explicit EncodeScratch(const ConstVolume& v)
        : reader(v), min(v.shape.x), max(v.shape.x), quantiser(v.shape.x) {}
    RowReader<T> reader;
    Array<T> min, max;
    QuantiserFor<T> quantiser;
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
OCTOBRICK_INLINE void write_end_points(const EncodeJob& job, EncodeScratch<T>& scratch,
                                       std::uint8_t* to) {
    const std::size_t nx = job.voxels.shape.x;
    const unsigned levels = (1u << job.bits) - 1;
    for (std::size_t x = 0; x < nx; x += job.block.x, to += 2 * sizeof(T)) {
        const std::size_t end = x + std::min(job.block.x, nx - x);
        T ends[2] = {*std::min_element(&scratch.min[x], scratch.min.data() + end),
                     *std::max_element(&scratch.max[x], scratch.max.data() + end)};
        if constexpr (std::is_floating_point_v<T>) {
            for (T& e : ends) {
                e += T{0};  // −0 becomes +0: which zero is "less" must not depend on the order
            }
        }
        std::memcpy(to, ends, sizeof ends);
        scratch.quantiser.set(x, end, ends[0], ends[1], levels);
    }
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
    write_end_points(job, scratch, job.code + slab * job.layout.grid.x * 2 * sizeof(T));

    for (std::size_t z = begin.z; z < end.z; ++z) {
        for (std::size_t y = begin.y; y < end.y; ++y) {
            write_row<T, B>(
                scratch, scratch.reader.row(z, y), shape.x,
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

// The first voxel in memory order that is not finite.
Outcome find_not_finite(const ConstVolume& voxels) {
    const RowReader<float> reader(voxels);
    for (std::size_t z = 0; z < voxels.shape.z; ++z) {
        for (std::size_t y = 0; y < voxels.shape.y; ++y) {
            const float* row = reader.row(z, y);
            for (std::size_t x = 0; x < voxels.shape.x; ++x) {
                if (!std::isfinite(row[x])) {
                    return {Status::not_finite, {z, y, x}, row[x], row[x]};
                }
            }
        }
    }
    return {Status::not_finite, {}, 0, 0};  // someone changed the voxels meanwhile
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
        scratch.emplace_back(job.voxels);
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
    detail::FirstFault fault;
    const detail::EncodeJob job{
        voxels, codec.block, codec.bits, layout, reinterpret_cast<std::uint8_t*>(code.data()),
        &fault};
    detail::with_sample_type(voxels.type,
                             [&]<class T>(T) { detail::run_encode<T>(job, execution); });
    if (fault.outcome().status == Status::not_finite) {
        return detail::find_not_finite(voxels);
    }
    return {};
}

}  // namespace octobrick::codec
