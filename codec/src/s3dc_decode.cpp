#include <algorithm>
#include <vector>

#include "faults.h"
#include "index_rows.h"
#include "octobrick/codec/s3dc.h"
#include "parallel.h"
#include "quantise.h"
#include "rows.h"
#include "s3dc_check.h"
#include "s3dc_scaled.h"

namespace octobrick::codec {
namespace detail {
namespace {

struct DecodeJob {
    Volume voxels;
    Zyx block;
    unsigned bits;
    Layout layout;
    const std::uint8_t* code;
    FirstFault* fault;
};

// T is unsigned or float: signed samples are decoded as unsigned ones of their width.
template <class T, unsigned B>
struct DecodeScratch {
    explicit DecodeScratch(const Volume& v) : writer(v), dequantiser(v.shape.x) {}
    RowWriter<T> writer;
    DequantiserFor<T, B> dequantiser;
};

// Step 2, undone: reads and checks the end points, and sets the dequantiser of every column.
template <class T, unsigned B>
OCTOBRICK_INLINE Outcome read_end_points(const DecodeJob& job, DecodeScratch<T, B>& scratch,
                                         Zyx block, const std::uint8_t* from) {
    const std::size_t nx = job.voxels.shape.x;
    for (std::size_t x = 0; x < nx; x += job.block.x, from += 2 * sizeof(T), ++block.x) {
        T ends[2];
        std::memcpy(ends, from, sizeof ends);
        if (!plausible(ends[0], ends[1], job.voxels.type)) {
            return bad_end_points(block, ends[0], ends[1], job.voxels.type);
        }
        scratch.dequantiser.set(x, x + std::min(job.block.x, nx - x), ends[0], ends[1]);
    }
    return {};
}

// Step 3, undone: one row of packed indices to one row of voxels. False where padding is set.
template <class T, unsigned B>
OCTOBRICK_INLINE bool read_row(const DecodeScratch<T, B>& scratch, const std::uint8_t* from,
                               std::size_t row_nbytes, std::size_t nx, T* row) {
    std::size_t x = 0;
    for (; x + kChunk <= nx; x += kChunk) {
        std::uint8_t room[kChunk];
        const std::uint8_t* indices = unpack_chunk<B>(from + x * B / 8, room);
        scratch.dequantiser.dequantise(indices, x, kChunk, row);
    }
    unsigned padding = 0;
    if (x < nx) {
        std::uint8_t indices[kChunk];
        unpack_tail<B>(from + x * B / 8, indices, row_nbytes - x * B / 8);
        scratch.dequantiser.dequantise(indices, x, nx - x, row);
        for (std::size_t i = nx - x; i < kChunk; ++i) {
            padding |= indices[i];
        }
    }
    return padding == 0;
}

// A slab is one (z, y) line of blocks over the whole length of x.
template <class T, unsigned B>
OCTOBRICK_INLINE void decode_slab(const DecodeJob& job, DecodeScratch<T, B>& scratch,
                                  std::size_t slab) {
    const Zyx shape = job.voxels.shape;
    const Zyx block = {slab / job.layout.grid.y, slab % job.layout.grid.y, 0};
    const Zyx begin = {block.z * job.block.z, block.y * job.block.y, 0};
    const Zyx end = {begin.z + std::min(job.block.z, shape.z - begin.z),
                     begin.y + std::min(job.block.y, shape.y - begin.y), shape.x};

    const Outcome read =
        read_end_points(job, scratch, block, job.code + slab * job.layout.grid.x * 2 * sizeof(T));
    if (read.status != Status::ok) {
        job.fault->report(slab, read);
        return;
    }
    for (std::size_t z = begin.z; z < end.z; ++z) {
        for (std::size_t y = begin.y; y < end.y; ++y) {
            const std::uint8_t* from =
                job.code + job.layout.end_points_nbytes + (z * shape.y + y) * job.layout.row_nbytes;
            if (!read_row(scratch, from, job.layout.row_nbytes, shape.x,
                          scratch.writer.row(z, y))) {
                job.fault->report(slab, {Status::bad_padding, {z, y, 0}, 0, 0});
                return;
            }
            scratch.writer.commit(z, y);
        }
    }
}

// See simd.h for what was measured.
template <class T, unsigned B>
inline constexpr bool kAvx512Pays = std::is_floating_point_v<T> || B == 1;

template <class T, unsigned B>
void run_decode(const DecodeJob& job, Execution execution) {
    const std::size_t slabs = job.layout.grid.z * job.layout.grid.y;
    const std::size_t nbytes =
        job.voxels.shape.z * job.voxels.shape.y * job.voxels.shape.x * sizeof(T);
    const unsigned threads = choose_threads(execution.threads, nbytes, slabs);
    const auto run = fastest<decode_slab<T, B>, kAvx512Pays<T, B>>(execution);

    std::vector<DecodeScratch<T, B>> scratch;
    scratch.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) {
        scratch.emplace_back(job.voxels);
    }
    parallel_for(slabs, threads,
                 [&](std::size_t slab, unsigned worker) { run(job, scratch[worker], slab); });
}

template <class T>
void run_decode(const DecodeJob& job, Execution execution) {
    switch (job.bits) {
        case 1: return run_decode<T, 1>(job, execution);
        case 2: return run_decode<T, 2>(job, execution);
        case 3: return run_decode<T, 3>(job, execution);
        case 4: return run_decode<T, 4>(job, execution);
        case 5: return run_decode<T, 5>(job, execution);
        case 6: return run_decode<T, 6>(job, execution);
        case 7: return run_decode<T, 7>(job, execution);
        case 8: return run_decode<T, 8>(job, execution);
    }
}

}  // namespace
}  // namespace detail

Outcome decode(const S3dc& codec, std::span<const std::byte> code, const Volume& voxels,
               Execution execution) {
    Layout layout;
    if (const Status s = make_layout(codec, voxels.type, voxels.shape, layout); s != Status::ok) {
        return {s, {}, 0, 0};
    }
    if (code.size() != layout.nbytes) {
        return {Status::wrong_nbytes, {}, 0, 0};
    }
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(code.data());
    if (codec.scaled) return detail::decode_scaled(codec, bytes, layout, voxels, execution);
    detail::FirstFault fault;
    const detail::DecodeJob job{voxels, codec.block, codec.bits, layout, bytes, &fault};
    switch (voxels.type) {
        case SampleType::u8:
        case SampleType::i8: detail::run_decode<std::uint8_t>(job, execution); break;
        case SampleType::u16:
        case SampleType::i16: detail::run_decode<std::uint16_t>(job, execution); break;
        case SampleType::f32: detail::run_decode<float>(job, execution); break;
    }
    return fault.outcome();
}

}  // namespace octobrick::codec
