// Histograms of volumes.
#pragma once

#include <cstdint>
#include <span>

#include "octobrick/codec/view.h"

namespace octobrick::codec {

// Adds 1 to counts[floor(v / 2^exponent) - first] for every voxel v. Exact: bins whose width is a
// power of two begin at the same values whatever is counted, so that the histograms of parts add
// up. Returns whether every voxel had a bin; if not, `counts` is unspecified. NaN has none.
// Thread-safe; does not throw but for lack of memory. -512 <= exponent <= 512; for whole
// numbers 0 <= exponent. There are less than 2^31 counts, |first| < 2^53, and
// less than 2^32 voxels along x. One thread works.
bool count_values(const ConstVolume& volume, int exponent, std::int64_t first,
                  std::span<std::uint64_t> counts, Execution execution = {});

}  // namespace octobrick::codec
