// What test programs share: checks that end the program loudly, files, and volumes in memory.
#pragma once

#include <octobrick/codec.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#define CHECK(condition) \
    ((condition) ? void() : check_failed(#condition, __FILE__, __LINE__, std::string()))
// The same, and says what was worked on.
#define CHECK_OF(condition, what) \
    ((condition) ? void() : check_failed(#condition, __FILE__, __LINE__, what))

[[noreturn]] inline void check_failed(const char* condition, const char* file, int line,
                                      const std::string& what) {
    std::fprintf(stderr, "%s:%d: not so: %s  %s\n", file, line, condition, what.c_str());
    std::exit(1);
}

using Bytes = std::vector<std::byte>;

inline Bytes read_file(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    CHECK_OF(file.good(), path.string());
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    const auto* bytes = reinterpret_cast<const std::byte*>(text.data());
    return {bytes, bytes + text.size()};
}

// A contiguous volume that lies in `bytes`.
template <class View, class Byte>
View packed(Byte* bytes, octobrick::codec::SampleType type, octobrick::codec::Zyx shape) {
    const auto unit = static_cast<std::ptrdiff_t>(octobrick::codec::sample_nbytes(type));
    const auto x = static_cast<std::ptrdiff_t>(shape.x), y = static_cast<std::ptrdiff_t>(shape.y);
    return {bytes, type, shape, {unit * x * y, unit * x, unit}};
}

// Every set of instructions, for what must not depend on it.
inline constexpr octobrick::codec::Execution kExecutions[] = {
    {.threads = 1, .simd = false},
    {.threads = 1, .avx512 = false},
    {.threads = 1},
};
