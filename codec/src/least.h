// The least of the indices that several workers report: whatever the thread count, the same.
#pragma once

#include <atomic>
#include <cstddef>

namespace octobrick::codec::detail {

// Items are taken in increasing order and each is finished up to its first fault, so the one with
// the least fault of all always gets here.
inline void report_least(std::atomic<std::size_t>& least, std::size_t index) {
    std::size_t known = least.load(std::memory_order_relaxed);
    while (index < known && !least.compare_exchange_weak(known, index)) {
    }
}

}  // namespace octobrick::codec::detail
