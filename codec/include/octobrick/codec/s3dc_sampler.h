// Samples of a volume at any points, taken straight from its S3Dc code, at a fixed rate or with a
// width per block: nothing is decoded but the voxels that a sample needs. Yela, Navazo, Vázquez
// 2008, sections 4.3 and 5, on a processor; docs/spec/s3dc.md ("Sampling") has every formula.
//
// A point is (x, y, z) in voxels: voxel i has its centre at i + 0.5, as in a texture. Points
// outside, infinite ones too, are moved to the nearest centre of a voxel. A point with a NaN
// coordinate has the sample NaN, and fetches what some point inside would fetch. All arithmetic is
// in double, and rounded to float once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "octobrick/codec/s3dc.h"

namespace octobrick::codec {

// Coordinates x, y, z of many points, one point behind the other, of either width.
class SamplePoints {
  public:
    // The size must be a multiple of 3.
    explicit SamplePoints(std::span<const float> xyz) : floats_(xyz.data()), n_(xyz.size() / 3) {}
    explicit SamplePoints(std::span<const double> xyz) : doubles_(xyz.data()), n_(xyz.size() / 3) {}

    std::size_t size() const { return n_; }

    // Calls f with the coordinates as an array of what they are.
    template <class F>
    void visit(const F& f) const {
        floats_ != nullptr ? f(floats_) : f(doubles_);
    }

  private:
    const float* floats_ = nullptr;
    const double* doubles_ = nullptr;
    std::size_t n_;
};

enum class Sampling : std::uint8_t {
    nearest,           // the voxel that the point lies in
    trilinear,         // between the eight nearest, each fetched and decoded by itself
    trilinear_shared,  // the same to the bit, what neighbours have in common being fetched once
};

// What sampling reads: what would be texture fetches on a GPU. With a width per block, every pair
// of end points comes with eight bytes of tables, and words of indices, or of raw voxels, have 32
// bits.
struct S3dcFetches {
    std::uint64_t end_points = 0;  // pairs of minimum and maximum
    std::uint64_t words = 0;       // 16-bit words of indices
};

// Safe to use from any threads at once; only opening throws, std::bad_alloc. Takes no memory for
// the voxels: it keeps no more than a view of the code, which must outlive it. If another thread
// changes the code meanwhile, samples are of any value, but nothing beyond the code is read.
class S3dcSampler {
  public:
    // Checks all that `decode` checks, and fails as it does, or with too_large where an axis has
    // more than INT32_MAX voxels, or bad_scales where the codec has trained ones; `sampler` is then
    // left as it was. `simd` as in Execution.
    static Outcome open(const S3dc& codec, SampleType type, Zyx shape,
                        std::span<const std::byte> code, std::unique_ptr<S3dcSampler>& sampler,
                        bool simd = true);
    // The same for a code with a width per block, and without a prediction: checks all that
    // `decode_variable` checks, and fails as it does.
    static Outcome open_variable(Zyx block, SampleType type, Zyx shape,
                                 std::span<const std::byte> code,
                                 std::unique_ptr<S3dcSampler>& sampler, bool simd = true);
    virtual ~S3dcSampler() = default;

    // Writes a sample for each point.
    virtual void sample(Sampling how, SamplePoints points, float* out) const = 0;

    // Writes the gradient of the trilinear samples at each point, (x, y, z) in sample units per
    // unit of spacing: along each axis, the difference of the samples one voxel further and one
    // voxel back, times 0.5 / spacing. Near a face the points are clamped, but the divisor stays,
    // as a shader has it: at the outermost centres the slope across the face is halved. Vectors
    // beyond the greatest float are scaled as `central_differences` does. `how` is a trilinear
    // one; spacings are within [1e-150, 1e150].
    virtual void gradient(Sampling how, SamplePoints points, const double (&spacing_zyx)[3],
                          float* out) const = 0;

    // What `sample` fetches for these points, by its own code.
    virtual S3dcFetches count_fetches(Sampling how, SamplePoints points) const = 0;
};

}  // namespace octobrick::codec
