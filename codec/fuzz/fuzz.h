// What fuzz targets share.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <span>

#include "octobrick/codec/view.h"

// Called once with every input; what it returns does not matter.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace octobrick::fuzz {

#define REQUIRE(condition) ::octobrick::fuzz::require(condition, #condition, __FILE__, __LINE__)

inline void require(bool condition, const char* what, const char* file, int line) {
    if (!condition) {
        std::fprintf(stderr, "%s:%d: not so: %s\n", file, line, what);
        std::abort();
    }
}

// Exactly as many as asked for, so that the sanitiser sees the first one too many. Zeroed.
template <class T>
class Exact {
  public:
    explicit Exact(std::size_t n) : items_(new T[n]()), n_(n) {}
    explicit Exact(std::span<const T> from) : Exact(from.size()) {
        std::copy(from.begin(), from.end(), items_.get());
    }
    T* data() const { return items_.get(); }
    std::span<T> span() const { return {items_.get(), n_}; }
    T& operator[](std::size_t i) const { return items_[i]; }

  private:
    std::unique_ptr<T[]> items_;
    std::size_t n_;
};

// Paths that must give the same.
inline constexpr codec::Execution kExecutions[] = {
    {.threads = 1},
    {.threads = 1, .avx512 = false},
    {.threads = 2, .simd = false},
};

}  // namespace octobrick::fuzz
