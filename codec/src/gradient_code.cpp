// Directions in three bytes: docs/spec/gradient-code.md, whose steps and letters these are.

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>

#include "least.h"
#include "octobrick/codec/gradients.h"
#include "parallel.h"
#include "simd.h"

namespace octobrick::codec {
namespace detail {
namespace {

constexpr std::uint8_t kZeroByte = 128;
constexpr int kGreatest = 255;
constexpr std::int32_t kSteps = 85;  // 255, 253 … 87: what 85 or less holds, 3 times it holds too
constexpr std::int32_t kStepMask = 127;
constexpr std::size_t kBatch = 64;          // directions whose search runs side by side
constexpr std::size_t kItem = 64 * kBatch;  // directions per piece of work of a thread

// ---- The transform (decoding, step 4) and its inverse ----
//
//   u = a - b, v = b - c, w = c            U = u (61 u + 39 a), and so for V, W
//   S = U + V + W, M = V + W               the direction is (S, M, W)
//
// Whole numbers below 2^24 for odd a, b, c up to 255: exact in float.
struct Magnitudes {
    float s, m, w;
};

OCTOBRICK_INLINE Magnitudes transform(float a, float b, float c) {
    const float u = a - b, v = b - c, w = c;
    const float big_u = u * (61 * u + 39 * a);
    const float big_v = v * (61 * v + 39 * a);
    const float big_w = w * (61 * w + 39 * a);
    return {big_u + (big_v + big_w), big_v + big_w, big_w};
}

// A point of the triangle, as the ratios b/a and c/a.
struct Ratios {
    float p, q;
};

// The solution u of 0.61 u^2 + 0.39 u = y, in the form that does not cancel; and the root in it.
template <class Real>
struct Root {
    Real discriminant, value;
    OCTOBRICK_INLINE explicit Root(Real y)
        : discriminant(std::sqrt(Real(0.1521) + Real(2.44) * y)),
          value(2 * y / (Real(0.39) + discriminant)) {}
};

// The transform before its normalisation is separable. So all that its inverse does not know is the
// scale of (u, v, w) at which their roots add up to 1: here it is on the nodes p = i/32, q = j/32.
class ScaleTable {
  public:
    static constexpr int kCells = 32;

    ScaleTable() {
        for (int i = 0; i <= kCells; ++i) {
            for (int j = 0; j <= i; ++j) nodes_[index(i, j)] = solve(i, j);
        }
    }

    // Linear between the three nearest nodes; p >= q.
    OCTOBRICK_INLINE float operator()(float p, float q) const {
        const float cells = kCells;
        const int i = std::min(static_cast<int>(p * cells), kCells - 1);
        const int j = std::min(static_cast<int>(q * cells), kCells - 1);
        const float along_p = p * cells - static_cast<float>(i);
        const float along_q = q * cells - static_cast<float>(j);
        const bool lower = along_p >= along_q;
        const float first = lower ? along_p : along_q, then = lower ? along_q : along_p;
        const float near = nodes_[index(i, j)], far = nodes_[index(i + 1, j + 1)];
        const float side = nodes_[index(i + lower, j + !lower)];
        return near + first * (side - near) + then * (far - side);
    }

  private:
    static std::size_t index(int i, int j) {
        return static_cast<std::size_t>(i * (kCells + 1) + j);
    }

    // Bisection, until the interval is one rounding wide.
    static float solve(int i, int j) {
        const double p = i / double{kCells}, q = j / double{kCells};
        double low = 0, high = 1;
        for (int step = 0; step < 53; ++step) {
            const double scale = (low + high) / 2;
            const double sum =
                Root(scale * (1 - p)).value + Root(scale * (p - q)).value + Root(scale * q).value;
            (sum < 1 ? low : high) = scale;
        }
        return static_cast<float>(high);
    }

    std::array<float, (kCells + 1) * (kCells + 1)> nodes_{};
};

const ScaleTable& scale_table() {
    static const ScaleTable table;  // 0.5 ms, at the first call
    return table;
}

// The point that the transform takes to (p, q): one Newton step from the table's scale, which
// leaves 6e-6 where the search can bear 1e-4.
OCTOBRICK_INLINE Ratios invert(const ScaleTable& scales, float p, float q) {
    const float u = 1 - p, v = p - q, w = q, scale = scales(p, q);
    const Root root_u(scale * u), root_v(scale * v), root_w(scale * w);
    const float excess = root_u.value + root_v.value + root_w.value - 1;
    const float slope = u / root_u.discriminant + v / root_v.discriminant + w / root_w.discriminant;
    const float better = scale - excess / slope;
    const float found_v = Root(better * v).value, found_w = Root(better * w).value;
    return {found_v + found_w, found_w};
}

// ---- Encoding ----

// Directions on their way through the search, one array per quantity.
template <class T>
struct Batch {
    alignas(64) T greatest[kBatch], least[kBatch];     // magnitudes of the vector's components
    alignas(64) float p[kBatch], q[kBatch];            // wanted
    alignas(64) float near_p[kBatch], near_q[kBatch];  // its inverse
    alignas(64) std::int32_t best[kBatch];             // the least key so far
};

// Steps 1 and 2. Returns whether all components are finite. A quotient of floats rounds to the same
// float in single precision as through double.
template <class T>
OCTOBRICK_INLINE bool sort_components(const T* __restrict vectors, std::size_t count,
                                      Batch<T>& batch) {
    int faults = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const T x = std::fabs(vectors[3 * i]);
        const T y = std::fabs(vectors[3 * i + 1]);
        const T z = std::fabs(vectors[3 * i + 2]);
        faults |= (x - x) + (y - y) + (z - z) == 0 ? 0 : 1;  // ∞ − ∞ is NaN
        const T low = std::min(x, y), high = std::max(x, y);
        const T a = std::max(high, z), b = std::max(low, std::min(high, z));
        const T c = std::min(low, z), divisor = a == 0 ? 1 : a;
        batch.greatest[i] = a;
        batch.least[i] = c;
        batch.p[i] = static_cast<float>(b / divisor);
        batch.q[i] = static_cast<float>(c / divisor);
    }
    return faults == 0;
}

// Step 3.
template <class T>
OCTOBRICK_INLINE void invert_transform(std::size_t count, Batch<T>& batch) {
    const ScaleTable& scales = scale_table();
    for (std::size_t i = 0; i < count; ++i) {
        const Ratios near = invert(scales, batch.p[i], batch.q[i]);
        batch.near_p[i] = near.p;
        batch.near_q[i] = near.q;
    }
}

// The odd integer nearest to `ratio * a`; half_a is a / 2.
OCTOBRICK_INLINE float nearest_odd(float ratio, float half_a) {
    return 2 * static_cast<float>(static_cast<int>(ratio * half_a)) + 1;
}

// |(1, p, q) × (S, M, W)|^2 / |(S, M, W)|^2, which orders like the angle, and is precise where
// a cosine would be 1 in float.
OCTOBRICK_INLINE float distance(float p, float q, Magnitudes found) {
    const float x = p * found.w - q * found.m;
    const float y = q * found.s - found.w;
    const float z = found.m - p * found.s;
    return (x * x + y * y + z * z) / (found.s * found.s + found.m * found.m + found.w * found.w);
}

// A distance whose last 7 bits say at which step it was found. Floats that are not negative order
// like their bits, so one minimum finds both; of equal distances the greatest `a` has the least
// key.
OCTOBRICK_INLINE std::int32_t key_of(float distance, std::int32_t step) {
    return (std::bit_cast<std::int32_t>(distance) & ~kStepMask) | step;
}

// Step 4: kBatch directions side by side, which is what vector instructions want.
template <class T>
OCTOBRICK_INLINE void search(Batch<T>& batch) {
    std::fill_n(batch.best, kBatch, std::numeric_limits<std::int32_t>::max());
    for (std::int32_t step = 0; step < kSteps; ++step) {
        const float a = static_cast<float>(kGreatest - 2 * step), half_a = a / 2;
        for (std::size_t i = 0; i < kBatch; ++i) {
            const float b = nearest_odd(batch.near_p[i], half_a);
            const float c = std::min(nearest_odd(batch.near_q[i], half_a), b);
            const float far = distance(batch.p[i], batch.q[i], transform(a, b, c));
            batch.best[i] = std::min(batch.best[i], key_of(far, step));
        }
    }
}

// The byte of one component: of the magnitude that its rank has, with its sign. Equal components
// have equal magnitudes.
template <class T>
OCTOBRICK_INLINE std::uint8_t byte_of(T value, T greatest, T least, float a, float b, float c) {
    const T size = std::fabs(value);
    const float odd = size == greatest ? a : size == least ? c : b;
    const std::int32_t twice = static_cast<std::int32_t>(value < 0 ? 255 - odd : 255 + odd);
    return static_cast<std::uint8_t>(greatest == 0 ? kZeroByte : twice / 2);
}

template <class T>
OCTOBRICK_INLINE void write_codes(const Batch<T>& batch, const T* __restrict vectors,
                                  std::size_t count, std::uint8_t* __restrict codes) {
    for (std::size_t i = 0; i < count; ++i) {
        const float a = static_cast<float>(kGreatest - 2 * (batch.best[i] & kStepMask));
        const float b = nearest_odd(batch.near_p[i], a / 2);
        const float c = std::min(nearest_odd(batch.near_q[i], a / 2), b);
        const T greatest = batch.greatest[i], least = batch.least[i];
        codes[3 * i] = byte_of(vectors[3 * i], greatest, least, a, b, c);
        codes[3 * i + 1] = byte_of(vectors[3 * i + 1], greatest, least, a, b, c);
        codes[3 * i + 2] = byte_of(vectors[3 * i + 2], greatest, least, a, b, c);
    }
}

// Encodes up to kBatch vectors; false where one is not finite.
template <class T>
OCTOBRICK_INLINE bool encode_batch(const T* vectors, std::size_t count, std::uint8_t* codes) {
    Batch<T> batch{};  // what is beyond `count` is searched too, and not written
    if (!sort_components(vectors, count, batch)) return false;
    invert_transform(count, batch);
    search(batch);
    write_codes(batch, vectors, count, codes);
    return true;
}

// The first vector that is not finite; there is one.
template <class T>
std::size_t first_not_finite(const T* vectors) {
    std::size_t k = 0;
    while (std::isfinite(vectors[k])) ++k;
    return k / 3;
}

template <class T>
std::size_t run_encode(std::span<const T> vectors, std::uint8_t* codes, Execution execution) {
    const std::size_t count = vectors.size() / 3, items = (count + kItem - 1) / kItem;
    const unsigned threads = choose_threads(execution.threads, vectors.size_bytes(), items);
    const auto encode = fastest<encode_batch<T>, true>(execution);
    std::atomic<std::size_t> fault{kAllFinite};
    parallel_for(items, threads, [&](std::size_t item, unsigned) {
        const std::size_t end = std::min(count, (item + 1) * kItem);
        for (std::size_t at = item * kItem; at < end; at += kBatch) {
            const T* from = vectors.data() + 3 * at;
            if (!encode(from, std::min(kBatch, end - at), codes + 3 * at)) {
                report_least(fault, at + first_not_finite(from));
                return;
            }
        }
    });
    return fault.load();
}

// ---- Decoding ----

OCTOBRICK_INLINE float component(float value, float magnitude, float a, float c, Magnitudes found,
                                 float scale) {
    const float size = (magnitude == a ? found.s : magnitude == c ? found.w : found.m) * scale;
    return value < 0 ? -size : size;
}

OCTOBRICK_INLINE void decode_run(const std::uint8_t* __restrict codes, float* __restrict vectors,
                                 std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
        const float x = static_cast<float>(2 * codes[3 * i] - 255);
        const float y = static_cast<float>(2 * codes[3 * i + 1] - 255);
        const float z = static_cast<float>(2 * codes[3 * i + 2] - 255);
        const float ax = std::fabs(x), ay = std::fabs(y), az = std::fabs(z);
        const float a = std::max(std::max(ax, ay), az), c = std::min(std::min(ax, ay), az);
        const Magnitudes found = transform(a, ax + ay + az - a - c, c);
        const float length_squared = found.s * found.s + found.m * found.m + found.w * found.w;
        const float scale = a <= 1 ? 0.0f : 1 / std::sqrt(length_squared);
        vectors[3 * i] = component(x, ax, a, c, found, scale);
        vectors[3 * i + 1] = component(y, ay, a, c, found, scale);
        vectors[3 * i + 2] = component(z, az, a, c, found, scale);
    }
}

}  // namespace
}  // namespace detail

std::size_t encode_directions(std::span<const float> vectors, std::span<std::uint8_t> codes,
                              Execution execution) {
    return detail::run_encode(vectors, codes.data(), execution);
}

std::size_t encode_directions(std::span<const double> vectors, std::span<std::uint8_t> codes,
                              Execution execution) {
    return detail::run_encode(vectors, codes.data(), execution);
}

void decode_directions(std::span<const std::uint8_t> codes, std::span<float> vectors,
                       Execution execution) {
    using detail::kItem;
    const std::size_t count = codes.size() / 3, items = (count + kItem - 1) / kItem;
    const unsigned threads = detail::choose_threads(execution.threads, vectors.size_bytes(), items);
    const auto decode = detail::fastest<detail::decode_run>(execution);
    detail::parallel_for(items, threads, [&](std::size_t item, unsigned) {
        const std::size_t at = item * kItem;
        decode(codes.data() + 3 * at, vectors.data() + 3 * at, std::min(kItem, count - at));
    });
}

}  // namespace octobrick::codec
