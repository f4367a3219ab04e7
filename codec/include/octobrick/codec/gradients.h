// Gradients of volumes: differences, reduction, and directions in three bytes.
//
// Every function is pure and thread-safe, does not throw but for lack of memory, and gives the same
// bits on every machine and thread count. Arrays of vectors are contiguous, components (x, y, z)
// fastest. The code of directions is specified in docs/spec/gradient-code.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "octobrick/codec/view.h"

namespace octobrick::codec {

// Where a vector or voxel that is NaN or infinite was found first, or kAllFinite.
inline constexpr std::size_t kAllFinite = SIZE_MAX;

// The greatest radius of `reduce_gradient`; its work grows with the cube.
inline constexpr unsigned kMaxReduceRadius = 16;

// Writes the gradient of every voxel, in sample units per unit of `spacing`, as 3 floats.
//   inside        (v[i + 1] - v[i - 1]) * (0.5 / spacing)
//   at a face     (v[1] - v[0]) * (1 / spacing), one-sided; likewise at the other end
//   length 1      0
// each in double, then rounded to float. A gradient with a component beyond the greatest float is
// scaled as a whole, so that this component is the greatest float: its direction stays.
// `gradient` has 3 · voxels floats; no axis is empty; spacings (z, y, x) are within
// [1e-150, 1e150]. Returns the flat index of the first voxel that is NaN or infinite, with
// `gradient` unspecified; else kAllFinite.
std::size_t central_differences(const ConstVolume& volume, const double (&spacing_zyx)[3],
                                std::span<float> gradient, Execution execution = {});

// Writes the gradient at half resolution: with m the magnitude and g a Gaussian of the distance to
// the coarse voxel's centre, which lies between two fine voxels on each axis,
//   (sum of g * m * gradient) / (sum of g * m)        over 2 * radius fine voxels per axis,
// those beyond the faces left out; 0 where all magnitudes are 0. In double, summed in the order z,
// y, x, rounded to float. NaN and infinities spread. `fine` has 3 floats a voxel of `shape`,
// `coarse` 3 a voxel of half_shape(shape); no axis is empty; 1 <= radius <= kMaxReduceRadius;
// sigma, in fine voxels, is above 0.
void reduce_gradient(std::span<const float> fine, Zyx shape, unsigned radius, double sigma,
                     std::span<float> coarse, Execution execution = {});

// A box of voxels of a volume.
struct Part {
    Zyx start, shape;
};

// Writes what `reduce_gradient` with a radius of 1 makes of the part of `central_differences` of
// the volume that lies in `part`, bit for bit, but keeps no fine gradient. Where the part ends
// inside the volume, the voxels beyond it serve as neighbours; for the same result whatever a whole
// is cut into, parts begin at even positions and end at even positions or at the face.
// `coarse` has 3 floats a voxel of half_shape(part.shape); the part is not empty and within the
// volume. Returns the flat index of the first coarse vector that is not finite, as those are that
// NaN or infinite voxels reach, with `coarse` unspecified; else kAllFinite.
std::size_t reduced_differences(const ConstVolume& volume, const Part& part,
                                const double (&spacing_zyx)[3], std::span<float> coarse,
                                Execution execution = {});

// Writes the code of every vector; `codes` has as many bytes as `vectors` has components, a
// multiple of 3. Returns the index of the first vector that is not finite, with `codes`
// unspecified; else kAllFinite.
std::size_t encode_directions(std::span<const float> vectors, std::span<std::uint8_t> codes,
                              Execution execution = {});
std::size_t encode_directions(std::span<const double> vectors, std::span<std::uint8_t> codes,
                              Execution execution = {});

// Writes a unit vector, or zero, for every code. All bytes are legal. The spans have equal sizes, a
// multiple of 3.
void decode_directions(std::span<const std::uint8_t> codes, std::span<float> vectors,
                       Execution execution = {});

}  // namespace octobrick::codec
