#include "parallel.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <thread>
#include <vector>

namespace octobrick::codec::detail {

namespace {
// Below this, starting threads costs more than it saves (about 1 ms of work at 4 GB/s).
constexpr std::size_t kWorthThreads_nbytes = std::size_t{4} << 20;
}  // namespace

unsigned choose_threads(unsigned asked, std::size_t nbytes, std::size_t items) noexcept {
    if (asked == 0) {
        asked = nbytes < kWorthThreads_nbytes ? 1 : std::thread::hardware_concurrency();
    }
    return static_cast<unsigned>(
        std::clamp<std::size_t>(asked, 1, std::max<std::size_t>(items, 1)));
}

void parallel_for(std::size_t items, unsigned threads,
                  const std::function<void(std::size_t item, unsigned worker)>& body) {
    std::atomic<std::size_t> next{0};
    const auto work = [&](unsigned worker) {
        for (std::size_t item; (item = next.fetch_add(1, std::memory_order_relaxed)) < items;) {
            body(item, worker);
        }
    };
    std::vector<std::thread> helpers;
    helpers.reserve(threads - 1);
    try {
        for (unsigned worker = 1; worker < threads; ++worker) helpers.emplace_back(work, worker);
    } catch (const std::exception&) {
        // The system has no thread to spare: those that run will do.
    }
    work(0);
    for (std::thread& helper : helpers) helper.join();
}

}  // namespace octobrick::codec::detail
