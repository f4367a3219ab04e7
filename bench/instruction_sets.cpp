// How fast the codec is with each set of instructions, one thread, a brick of 64^3 in cache:
//
//   cmake -S . -B build/sets -DOCTOBRICK_PYTHON=OFF -DOCTOBRICK_BENCH=ON \
//     -DCMAKE_CXX_FLAGS=-DOCTOBRICK_AVX512_EVERYWHERE
//   cmake --build build/sets && build/sets/codec/instruction_sets
//
// The flag compiles for AVX-512 also what is not worth it: the table in codec/src/simd.h says what
// is. Sets take turns, a few milliseconds each; the figures are medians.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "octobrick/codec.h"

namespace {

using namespace octobrick::codec;
using Clock = std::chrono::steady_clock;

constexpr Execution kSets[] = {
    {.threads = 1, .simd = false}, {.threads = 1, .avx512 = false}, {.threads = 1}};
constexpr std::size_t kEdge = 64, kVoxels = kEdge * kEdge * kEdge;
constexpr double kSeconds = 0.9;  // for one line
constexpr int kCalls = 8;         // for one time: longer than the clock's steps

double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

double median(std::vector<double> times) {
    std::nth_element(times.begin(), times.begin() + times.size() / 2, times.end());
    return times[times.size() / 2];
}

void measure(const std::string& name, std::size_t nbytes,
             const std::function<void(Execution)>& call) {
    std::vector<double> times[3];
    for (const auto start = Clock::now(); seconds_since(start) < kSeconds;) {
        for (int set = 0; set < 3; ++set) {
            call(kSets[set]);  // the caches are the last set's
            const auto begin = Clock::now();
            for (int i = 0; i < kCalls; ++i) call(kSets[set]);
            times[set].push_back(seconds_since(begin) / kCalls);
        }
    }
    const double plain = median(times[0]), avx2 = median(times[1]), avx512 = median(times[2]);
    std::printf("%-20s %6.2f GB/s   AVX2 %5.2f times that   AVX-512 %5.2f times AVX2\n",
                name.c_str(), static_cast<double>(nbytes) / plain / 1e9, plain / avx2,
                avx2 / avx512);
    std::fflush(stdout);
}

template <class T>
Strides strides(std::size_t edge) {
    const auto n = static_cast<std::ptrdiff_t>(edge), unit = std::ptrdiff_t{sizeof(T)};
    return {n * n * unit, n * unit, unit};
}

// Waves and noise over most of the range.
template <class T>
std::vector<T> scene() {
    std::mt19937 random(1);
    std::normal_distribution<double> noise(0, 0.04);
    std::vector<T> voxels(kVoxels);
    for (std::size_t i = 0; i < kVoxels; ++i) {
        const double x = static_cast<double>(i % kEdge) / kEdge;
        const double y = static_cast<double>(i / kEdge % kEdge) / kEdge;
        const double z = static_cast<double>(i / kEdge / kEdge) / kEdge;
        const double wave = 0.5 + 0.3 * std::sin(9 * x + 4 * y) * std::cos(7 * z - 3 * y);
        const double value = std::clamp(wave + noise(random), 0.0, 1.0);
        const double scale =
            std::is_floating_point_v<T> ? 1000 : static_cast<double>(std::numeric_limits<T>::max());
        voxels[i] = static_cast<T>(scale * value);
    }
    return voxels;
}

template <class T>
void measure_type(const std::string& name, SampleType type) {
    constexpr Zyx kShape = {kEdge, kEdge, kEdge}, kHalf = half_shape(kShape);
    const std::vector<T> voxels = scene<T>();
    std::vector<T> decoded(kVoxels), coarse(kVoxels / 8);
    const std::size_t nbytes = kVoxels * sizeof(T);
    const auto read = [&](const std::vector<T>& from) {
        return ConstVolume{std::as_bytes(std::span(from)).data(), type, kShape, strides<T>(kEdge)};
    };
    const Volume out{std::as_writable_bytes(std::span(decoded)).data(), type, kShape,
                     strides<T>(kEdge)};
    const Volume half{std::as_writable_bytes(std::span(coarse)).data(), type, kHalf,
                      strides<T>(kEdge / 2)};
    for (const unsigned bits : {1u, 2u, 4u, 8u}) {
        const S3dc codec{{8, 8, 8}, bits};
        Layout layout;
        if (make_layout(codec, type, kShape, layout) != Status::ok) return;
        std::vector<std::byte> code(layout.nbytes);
        const std::string what = name + " " + std::to_string(bits) + " bit ";
        measure(what + "encode", nbytes,
                [&](Execution e) { encode(codec, read(voxels), code, e); });
        measure(what + "decode", nbytes, [&](Execution e) { decode(codec, code, out, e); });
    }
    measure(name + " mean2", nbytes, [&](Execution e) { mean2(read(voxels), half, e); });
    ErrorStats stats;
    measure(name + " compare", nbytes,
            [&](Execution e) { compare(read(voxels), read(decoded), stats, e); });
}

}  // namespace

int main() {
    measure_type<std::uint8_t>("uint8", SampleType::u8);
    measure_type<std::uint16_t>("uint16", SampleType::u16);
    measure_type<float>("float32", SampleType::f32);

    std::mt19937 random(1);
    std::normal_distribution<float> normal;
    std::vector<float> vectors(3 * 8192);
    for (float& v : vectors) v = normal(random);
    std::vector<std::uint8_t> codes(vectors.size());
    const std::size_t nbytes = vectors.size() * sizeof(float);
    measure("directions encode", nbytes,
            [&](Execution e) { encode_directions(std::span<const float>(vectors), codes, e); });
    measure("directions decode", nbytes,
            [&](Execution e) { decode_directions(codes, vectors, e); });
}
