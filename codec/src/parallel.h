// Work shared among threads that live no longer than the call.
#pragma once

#include <cstddef>
#include <functional>

namespace octobrick::codec::detail {

// How many threads to use for `items` pieces of work on `nbytes` of voxels; at least 1.
unsigned choose_threads(unsigned asked, std::size_t nbytes, std::size_t items) noexcept;

// Calls body(item, worker) for every item in [0, items), worker < threads, items being taken in
// increasing order; the caller is worker 0. `body` must not throw. Where the system refuses a
// thread, the others do its work. No pool is kept: a pool would not survive a fork, and starting
// a thread costs little next to the 4 MiB that make it worth while.
void parallel_for(std::size_t items, unsigned threads,
                  const std::function<void(std::size_t item, unsigned worker)>& body);

}  // namespace octobrick::codec::detail
