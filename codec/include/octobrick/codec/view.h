// Volumes in memory: what a sample is, and where each one lies.
#pragma once

#include <cstddef>
#include <cstdint>

namespace octobrick::codec {

enum class SampleType : std::uint8_t { u8, i8, u16, i16, f32 };

// Bytes of one sample.
constexpr std::size_t sample_nbytes(SampleType type) {
    switch (type) {
        case SampleType::u8:
        case SampleType::i8: return 1;
        case SampleType::u16:
        case SampleType::i16: return 2;
        case SampleType::f32: return 4;
    }
    return 0;
}

// A position, an extent or a count along each axis; z is the slowest axis, x the fastest.
struct Zyx {
    std::size_t z = 0, y = 0, x = 0;
    bool operator==(const Zyx&) const = default;
};

// Bytes from one sample to the next along each axis. Any values: negative, zero (a repeated
// sample), or such that samples are not aligned.
struct Strides {
    std::ptrdiff_t z = 0, y = 0, x = 0;
};

// Samples in native byte order; the sample (z, y, x) lies at origin + z*strides.z + y*strides.y
// + x*strides.x. The view owns nothing.
struct ConstVolume {
    const std::byte* origin = nullptr;
    SampleType type = SampleType::u8;
    Zyx shape;
    Strides strides;
};

// The same, for writing. No two samples may share a byte.
struct Volume {
    std::byte* origin = nullptr;
    SampleType type = SampleType::u8;
    Zyx shape;
    Strides strides;
};

// How to run a function: never what it computes.
struct Execution {
    // Threads that may work, the caller's included; 0 chooses: one for less than 4 MiB of
    // voxels, else one per processor that this process may use.
    unsigned threads = 0;
    // Whether to use the instructions that this processor has beyond the baseline.
    bool simd = true;
    // Whether AVX-512 may be among them. Some of the first processors that had it run everything
    // else slower meanwhile.
    bool avx512 = true;
};

}  // namespace octobrick::codec
