// parallel_for for bodies that take memory, and so may throw.
#pragma once

#include <exception>
#include <mutex>

#include "parallel.h"

namespace octobrick::codec::detail {

// As parallel_for. Of several exceptions one is thrown again when all threads are done.
template <class Body>
void guarded_parallel_for(std::size_t items, unsigned threads, const Body& body) {
    std::mutex mutex;
    std::exception_ptr thrown;
    parallel_for(items, threads, [&](std::size_t item, unsigned worker) {
        try {
            body(item, worker);
        } catch (...) {
            const std::lock_guard lock(mutex);
            thrown = std::current_exception();
        }
    });
    if (thrown) std::rethrow_exception(thrown);
}

}  // namespace octobrick::codec::detail
