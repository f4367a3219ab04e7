#include "octobrick/codec/value_counts.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "rows.h"
#include "simd.h"

namespace octobrick::codec {
namespace detail {
namespace {

// Neighbours are often equal, and a count that was just written is slow to read again: so voxels
// take turns among several tables. Narrow counts, that the tables stay in the nearest cache.
constexpr std::size_t kTables = 4;
using Count = std::uint32_t;
constexpr std::size_t kCountMax = UINT32_MAX;

// What is counted: bins of width 2^exponent, from the one numbered `first` on.
struct Bins {
    int exponent;
    std::int64_t first;
    std::size_t count;
};

// The bin of every voxel of a row, in [0, count]; `count` stands for those that have none.
template <class T>
OCTOBRICK_INLINE void find_bins(const T* __restrict row, std::size_t nx, const Bins& bins,
                                std::uint32_t* __restrict found) {
    if constexpr (std::is_floating_point_v<T>) {
        const double scale = std::ldexp(1.0, -bins.exponent);
        const double first = static_cast<double>(bins.first);
        const double end = static_cast<double>(bins.count);
        for (std::size_t x = 0; x < nx; ++x) {
            const double bin = std::floor(static_cast<double>(row[x]) * scale) - first;
            // Also for NaN, which is nowhere.
            found[x] = static_cast<std::uint32_t>(
                static_cast<std::int32_t>(bin >= 0 && bin < end ? bin : end));
        }
    } else {
        // Samples have 16 bits: a bin far away is as good as one just outside.
        const auto first =
            static_cast<std::int32_t>(std::clamp<std::int64_t>(bins.first, -0x20000, 0x20000));
        const auto end = static_cast<std::uint32_t>(bins.count);
        const int shift = std::min(bins.exponent, 31);
        for (std::size_t x = 0; x < nx; ++x) {
            const auto bin = static_cast<std::uint32_t>((std::int32_t{row[x]} >> shift) - first);
            found[x] = bin < end ? bin : end;
        }
    }
}

inline void count_row(const std::uint32_t* found, std::size_t nx, std::size_t size, Count* tables) {
    std::size_t x = 0;
    for (; x + kTables <= nx; x += kTables) {
        for (std::size_t table = 0; table < kTables; ++table) {
            ++tables[table * size + found[x + table]];
        }
    }
    for (; x < nx; ++x) ++tables[found[x]];
}

template <class T>
bool run(const ConstVolume& volume, const Bins& bins, std::span<std::uint64_t> counts,
         Execution execution) {
    const auto find = fastest<find_bins<T>, true>(execution);
    const RowReader<T> rows(volume);
    const std::size_t size = bins.count + 1, nx = volume.shape.x;
    Array<std::uint32_t> found(nx);
    Array<Count> tables(kTables * size);
    std::uint64_t without = 0;
    const auto empty = [&] {
        for (std::size_t table = 0; table < kTables; ++table) {
            Count* own = tables.data() + table * size;
            for (std::size_t bin = 0; bin < bins.count; ++bin) counts[bin] += own[bin];
            without += own[bins.count];
            std::fill_n(own, size, Count{0});
        }
    };
    std::size_t counted = 0;
    for (std::size_t z = 0; z < volume.shape.z; ++z) {
        for (std::size_t y = 0; y < volume.shape.y; ++y) {
            if (kCountMax - counted < nx) {
                empty();
                counted = 0;
            }
            find(rows.row(z, y), nx, bins, found.data());
            count_row(found.data(), nx, size, tables.data());
            counted += nx;
        }
    }
    empty();
    return without == 0;
}

}  // namespace
}  // namespace detail

bool count_values(const ConstVolume& volume, int exponent, std::int64_t first,
                  std::span<std::uint64_t> counts, Execution execution) {
    const detail::Bins bins{exponent, first, counts.size()};
    return detail::with_sample_type(
        volume.type, [&]<class T>(T) { return detail::run<T>(volume, bins, counts, execution); });
}

}  // namespace octobrick::codec
