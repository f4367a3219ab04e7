#include <algorithm>
#include <limits>
#include <vector>

#include "end_points.h"
#include "faults.h"
#include "index_rows.h"
#include "octobrick/codec/s3dc_variable.h"
#include "parallel.h"
#include "quantise.h"
#include "rows.h"
#include "s3dc_variable_format.h"

namespace octobrick::codec {
namespace detail {
namespace {

struct DecodeJob {
    const VariableLayout& layout;
    Tables tables;
    const ConstVolume* prediction;
    Volume voxels;
    FirstFault* fault;
};

// What one thread needs. T is the sample type.
template <class T>
struct DecodeScratch {
    explicit DecodeScratch(const DecodeJob& job)
        : out(job.voxels, job.layout.block),
          prediction(job.prediction != nullptr ? *job.prediction : ConstVolume{},
                     job.prediction != nullptr ? job.layout.block : Zyx{}),
          block(whole_chunks(job.layout)),
          expected(job.prediction != nullptr ? block_voxels(job.layout.block) : 0) {}

    static std::size_t block_voxels(Zyx block) { return block.z * block.y * block.x; }

    static std::size_t whole_chunks(const VariableLayout& layout) {
        const std::size_t indices = layout.unit_nbytes * 8;
        return (indices + kChunk - 1) / kChunk * kChunk;
    }

    SlabRows<T, Volume> out;
    SlabRows<T, ConstVolume> prediction;
    Array<Unsigned<T>> block;  // one block's voxels, or differences, as if it were not cut
    Array<T> expected;         // its prediction, and then the voxels
};

// Step 1: the indices of a block to values, 64 at a time.
template <class U, unsigned W>
class BlockDequantiser {
  public:
    BlockDequantiser(U min, U max) : min_(min), max_(max) {
        if constexpr (std::is_floating_point_v<U>) {
            range_ = static_cast<double>(max) - static_cast<double>(min);
        } else if constexpr (W <= 8 && sizeof(U) == 2) {
            range_ = static_cast<U>(static_cast<U>(max - min) / kLevels);
            rest_ = static_cast<U>(static_cast<U>(max - min) % kLevels);
        } else {
            range_ = static_cast<U>(max - min);
        }
    }

    template <class Index>
    OCTOBRICK_INLINE void operator()(const Index* indices, U* to) const {
        for (std::size_t i = 0; i < kChunk; ++i) {
            if constexpr (std::is_floating_point_v<U>) {
                to[i] = decoded_float<W>(min_, max_, range_, indices[i]);
            } else if constexpr (sizeof(U) == 1) {
                to[i] = decoded8<W>(min_, range_, indices[i]);
            } else if constexpr (W <= 8) {
                to[i] = decoded16<W>(min_, range_, rest_, indices[i]);
            } else {  // below 2^16 · 2^14 + 2^13
                const std::uint32_t scaled = std::uint32_t{range_} * indices[i] + kLevels / 2;
                to[i] = static_cast<U>(min_ + scaled / kLevels);
            }
        }
    }

  private:
    static constexpr std::uint32_t kLevels = (1u << W) - 1;
    U min_, max_;
    std::conditional_t<std::is_floating_point_v<U>, double, U> range_;
    U rest_ = 0;
};

template <class U, unsigned W>
OCTOBRICK_INLINE void read_indices(const std::uint8_t* from, std::size_t indices, U min, U max,
                                   U* to) {
    const BlockDequantiser<U, W> dequantise(min, max);
    if constexpr (W <= 8) {
        for (std::size_t i = 0; i < indices; i += kChunk) {
            std::uint8_t room[kChunk];
            if (i + kChunk <= indices) {
                dequantise(unpack_chunk<W>(from + i * W / 8, room), to + i);
            } else {
                unpack_tail<W>(from + i * W / 8, room, kIndicesPerUnit * W / 8);
                dequantise(room, to + i);
            }
        }
    } else {  // the low bytes of all indices, then their high bits
        const std::uint8_t* high = from + indices;
        for (std::size_t i = 0; i < indices; i += kChunk) {
            const std::size_t n = std::min(kChunk, indices - i);
            std::uint8_t room[kChunk];
            unpack_tail<W - 8>(high + i * (W - 8) / 8, room, n * (W - 8) / 8);
            std::uint16_t wide[kChunk] = {};
            for (std::size_t k = 0; k < n; ++k) {
                wide[k] = static_cast<std::uint16_t>(from[i + k] | room[k] << 8);
            }
            dequantise(wide, to + i);
        }
    }
}

// All values of a block: voxels, or differences.
template <class U>
OCTOBRICK_INLINE void read_block(const std::uint8_t* from, unsigned width, std::size_t indices,
                                 U min, U max, U* to) {
    switch (width) {
        case 0: std::fill_n(to, indices, min); return;
        case 1: return read_indices<U, 1>(from, indices, min, max, to);
        case 2: return read_indices<U, 2>(from, indices, min, max, to);
        case 3: return read_indices<U, 3>(from, indices, min, max, to);
        case 4: return read_indices<U, 4>(from, indices, min, max, to);
        case 5: return read_indices<U, 5>(from, indices, min, max, to);
        case 6: return read_indices<U, 6>(from, indices, min, max, to);
        case 7: return read_indices<U, 7>(from, indices, min, max, to);
        case 8: return read_indices<U, 8>(from, indices, min, max, to);
    }
    if constexpr (sizeof(U) > 1) {
        switch (width) {
            case 9: return read_indices<U, 9>(from, indices, min, max, to);
            case 10: return read_indices<U, 10>(from, indices, min, max, to);
            case 11: return read_indices<U, 11>(from, indices, min, max, to);
            case 12: return read_indices<U, 12>(from, indices, min, max, to);
            case 13: return read_indices<U, 13>(from, indices, min, max, to);
            case 14: return read_indices<U, 14>(from, indices, min, max, to);
        }
    }
}

// Step 2: differences to voxels. The prediction is gathered as the block lies, so that one long
// loop does the work. Step 3: voxels to their rows.
//
// A row of a block has few voxels: with their usual numbers as constants it is copied by one
// instruction, where a loop would cost more than all else. X = 0 is any number.
template <std::size_t X, class Sample, class Copy>
OCTOBRICK_INLINE void for_each_row(Zyx block, Zyx extent, Sample* rows, std::ptrdiff_t z_stride,
                                   std::ptrdiff_t y_stride, const Copy& copy) {
    for (std::size_t z = 0; z < extent.z; ++z) {
        for (std::size_t y = 0; y < extent.y; ++y) {
            copy(rows + static_cast<std::ptrdiff_t>(z) * z_stride +
                     static_cast<std::ptrdiff_t>(y) * y_stride,
                 (z * block.y + y) * block.x, X > 0 ? X : extent.x);
        }
    }
}

template <std::size_t X, class T>
OCTOBRICK_INLINE void place_block(const DecodeJob& job, const DecodeScratch<T>& scratch,
                                  bool predicted, std::size_t x, Zyx extent) {
    const Zyx block = job.layout.block;
    T* voxels = reinterpret_cast<T*>(scratch.block.data());
    if (predicted) {
        T* expected = scratch.expected.data();
        for_each_row<X>(block, extent, scratch.prediction.row(0, 0) + x,
                        scratch.prediction.z_stride(), scratch.prediction.y_stride(),
                        [&](const T* row, std::size_t at, std::size_t n) OCTOBRICK_INLINE_LAMBDA {
                            std::memcpy(expected + at, row, n * sizeof(T));
                        });
        const auto* difference = reinterpret_cast<const Difference<T>*>(voxels);
        const std::size_t count = scratch.block_voxels(block);
        for (std::size_t i = 0; i < count; ++i) {
            expected[i] = predicted_plus(expected[i], difference[i]);
        }
        voxels = expected;
    }
    for_each_row<X>(block, extent, scratch.out.row(0, 0) + x, scratch.out.z_stride(),
                    scratch.out.y_stride(),
                    [&](T* row, std::size_t at, std::size_t n)
                        OCTOBRICK_INLINE_LAMBDA { std::memcpy(row, voxels + at, n * sizeof(T)); });
}

template <class T>
OCTOBRICK_INLINE void place_block(const DecodeJob& job, const DecodeScratch<T>& scratch,
                                  bool predicted, Zyx at, Zyx extent) {
    const std::size_t x = at.x * job.layout.block.x;
    switch (extent.x) {
        case 4: return place_block<4>(job, scratch, predicted, x, extent);
        case 8: return place_block<8>(job, scratch, predicted, x, extent);
        case 16: return place_block<16>(job, scratch, predicted, x, extent);
        default: return place_block<0>(job, scratch, predicted, x, extent);
    }
}

// The voxels of an uncoded block, each within its end points: so they are finite.
template <class T>
bool read_raw(const std::uint8_t* from, Zyx block, Zyx extent, T min, T max, T* to) {
    bool within = true;
    std::memcpy(to, from, block.z * block.y * block.x * sizeof(T));
    for (std::size_t z = 0; z < extent.z; ++z) {
        for (std::size_t y = 0; y < extent.y; ++y) {
            const T* row = to + (z * block.y + y) * block.x;
            for (std::size_t x = 0; x < extent.x; ++x) within &= row[x] >= min && row[x] <= max;
        }
    }
    return within;
}

// Blocks (z, y) of the grid over the whole length of x.
template <class T>
OCTOBRICK_INLINE void decode_slab(const DecodeJob& job, DecodeScratch<T>& scratch,
                                  std::size_t slab) {
    using U = Unsigned<T>;
    const VariableLayout& layout = job.layout;
    const std::size_t indices = layout.unit_nbytes * 8;
    std::size_t block = slab * layout.grid.x;
    const Zyx first = place_of(block, layout.grid);
    const Zyx begin = {first.z * layout.block.z, first.y * layout.block.y, 0};
    const Zyx rows = extent_of(first, layout.block, job.voxels.shape);
    const Zyx end = {begin.z + rows.z, begin.y + rows.y, 0};
    scratch.out.open(begin, end);
    if (job.prediction != nullptr) scratch.prediction.open(begin, end);

    const std::uint8_t* from = job.tables.payload(block);
    for (Zyx at = first; at.x < layout.grid.x; ++at.x, ++block) {
        const unsigned width = job.tables.width(block);
        const bool predicted = job.tables.predicted(block);
        const EndPoints<T> ends(job.tables.end_points(block), predicted);
        if (!ends.plausible()) {
            job.fault->report(slab,
                              {Status::bad_end_points, at, ends.min_number(), ends.max_number()});
            return;
        }
        const Zyx extent = extent_of(at, layout.block, job.voxels.shape);
        if (width == kRaw) {
            if (!read_raw<T>(from, layout.block, extent, ends.template min<T>(),
                             ends.template max<T>(), reinterpret_cast<T*>(scratch.block.data()))) {
                job.fault->report(slab, {Status::bad_raw, at, 0, 0});
                return;
            }
        } else {
            read_block<U>(from, width, indices, ends.template min<U>(), ends.template max<U>(),
                          scratch.block.data());
        }
        place_block(job, scratch, predicted, at, extent);
        from += units_of(width, job.voxels.type) * layout.unit_nbytes;
    }
    scratch.out.commit();
}

template <class T>
void run_decode(const DecodeJob& job, Execution execution) {
    const Zyx shape = job.voxels.shape;
    const std::size_t slabs = job.layout.grid.z * job.layout.grid.y;
    const unsigned threads =
        choose_threads(execution.threads, shape.z * shape.y * shape.x * sizeof(T), slabs);
    const auto run = fastest<decode_slab<T>, std::is_floating_point_v<T>>(execution);
    std::vector<DecodeScratch<T>> scratch;
    scratch.reserve(threads);
    for (unsigned i = 0; i < threads; ++i) scratch.emplace_back(job);
    parallel_for(slabs, threads,
                 [&](std::size_t slab, unsigned worker) { run(job, scratch[worker], slab); });
}

}  // namespace
}  // namespace detail

Outcome decode_variable(Zyx block, std::span<const std::byte> code, const ConstVolume* prediction,
                        const Volume& voxels, Execution execution) {
    VariableLayout layout;
    const Status status =
        make_variable_layout(block, voxels.type, voxels.shape, prediction != nullptr, layout);
    if (status != Status::ok) return {status, {}, 0, 0};
    const Outcome predicted = detail::check_prediction(prediction, voxels.type, voxels.shape);
    if (predicted.status != Status::ok) return predicted;
    const Outcome tables = detail::check_tables(layout, code, voxels.type);
    if (tables.status != Status::ok) return tables;

    detail::FirstFault fault;
    const detail::DecodeJob job{
        layout,
        detail::Tables(layout, reinterpret_cast<const std::uint8_t*>(code.data()), voxels.type),
        prediction, voxels, &fault};
    detail::with_sample_type(voxels.type,
                             [&]<class T>(T) { detail::run_decode<T>(job, execution); });
    return fault.outcome();
}

}  // namespace octobrick::codec
