// Gradients for Python: all arrays contiguous, as octobrick.codec.gradients makes them.

#include "octobrick/codec/gradients.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <optional>
#include <tuple>

#include "bindings.h"
#include "buffer.h"
#include "contiguous.h"
#include "octobrick/codec/reduce.h"

namespace nb = nanobind;
using namespace octobrick::codec;

namespace {

template <class T>
using Flat = nb::ndarray<T, nb::c_contig, nb::device::cpu>;

template <class T>
std::span<T> span_of(const Flat<T>& array) {
    return {array.data(), array.size()};
}

// Where something was found, or None.
std::optional<std::size_t> found_at(std::size_t index) {
    return index == kAllFinite ? std::nullopt : std::optional(index);
}

std::optional<std::size_t> differences_into(const AnyVolume& volume,
                                            std::tuple<double, double, double> spacing_zyx,
                                            const Flat<float>& gradient, unsigned threads) {
    const ConstVolume voxels = volume_of(volume);
    const auto [sz, sy, sx] = spacing_zyx;
    require(gradient.size() == 3 * volume.size(), "a gradient has three floats a voxel");
    const nb::gil_scoped_release unlocked;
    return found_at(central_differences(voxels, {sz, sy, sx}, span_of(gradient), {threads, true}));
}

void reduce_into(const Flat<const float>& fine, const Flat<float>& coarse, unsigned radius,
                 double sigma, unsigned threads) {
    require(fine.ndim() == 4 && coarse.ndim() == 4, "expected four axes (z, y, x, 3)");
    const Zyx shape{fine.shape(0), fine.shape(1), fine.shape(2)};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        require(coarse.shape(axis) == (fine.shape(axis) + 1) / 2, "expected half the shape");
    }
    require(fine.shape(3) == 3 && coarse.shape(3) == 3, "expected three components");
    require(radius >= 1 && radius <= kMaxReduceRadius && sigma > 0, "radius or sigma out of range");
    const nb::gil_scoped_release unlocked;
    reduce_gradient(span_of(fine), shape, radius, sigma, span_of(coarse), {threads, true});
}

using Triple = std::tuple<std::size_t, std::size_t, std::size_t>;

Zyx zyx_of(const Triple& t) { return {std::get<0>(t), std::get<1>(t), std::get<2>(t)}; }

bool is_within(std::size_t start, std::size_t count, std::size_t n) {
    return count > 0 && start < n && count <= n - start;
}

std::optional<std::size_t> reduced_into(nb::handle volume, const Triple& start, const Triple& shape,
                                        std::tuple<double, double, double> spacing_zyx,
                                        const Flat<float>& coarse, unsigned threads, bool simd) {
    const Buffer buffer(volume, PyBUF_STRIDES | PyBUF_FORMAT);
    const auto voxels = buffer.volume<ConstVolume>();
    const Part part{zyx_of(start), zyx_of(shape)};
    require(is_within(part.start.z, part.shape.z, voxels.shape.z) &&
                is_within(part.start.y, part.shape.y, voxels.shape.y) &&
                is_within(part.start.x, part.shape.x, voxels.shape.x),
            "the part is empty, or leaves the volume");
    const Zyx half = half_shape(part.shape);
    require(coarse.size() == 3 * half.z * half.y * half.x, "expected half the shape");
    const auto [sz, sy, sx] = spacing_zyx;
    const nb::gil_scoped_release unlocked;
    return found_at(
        reduced_differences(voxels, part, {sz, sy, sx}, span_of(coarse), {threads, simd}));
}

template <class T>
std::optional<std::size_t> encode_into(const Flat<const T>& vectors,
                                       const Flat<std::uint8_t>& codes, unsigned threads,
                                       bool simd) {
    require(vectors.size() == codes.size() && codes.size() % 3 == 0, "expected equal sizes");
    const nb::gil_scoped_release unlocked;
    return found_at(encode_directions(span_of(vectors), span_of(codes), {threads, simd}));
}

std::optional<std::size_t> encode_any(const nb::object& vectors, const Flat<std::uint8_t>& codes,
                                      unsigned threads, bool simd) {
    Flat<const float> narrow;
    if (nb::try_cast(vectors, narrow, false)) {
        return encode_into(narrow, codes, threads, simd);
    }
    return encode_into(nb::cast<Flat<const double>>(vectors, false), codes, threads, simd);
}

void decode_into(const Flat<const std::uint8_t>& codes, const Flat<float>& vectors,
                 unsigned threads, bool simd) {
    require(vectors.size() == codes.size() && codes.size() % 3 == 0, "expected equal sizes");
    const nb::gil_scoped_release unlocked;
    decode_directions(span_of(codes), span_of(vectors), {threads, simd});
}

}  // namespace

void bind_gradients(nb::module_& m) {
    m.attr("MAX_REDUCE_RADIUS") = kMaxReduceRadius;
    m.def("central_differences_into", &differences_into, nb::arg("volume"), nb::arg("spacing_zyx"),
          nb::arg("gradient").noconvert(), nb::arg("threads") = 0,
          nb::sig("def central_differences_into(volume: object, spacing_zyx: tuple[float, float, "
                  "float], gradient: object, threads: int = 0) -> int | None"),
          "The gradient of a volume; the first voxel that is not finite, or None.");
    m.def("reduce_gradient_into", &reduce_into, nb::arg("fine").noconvert(),
          nb::arg("coarse").noconvert(), nb::arg("radius"), nb::arg("sigma"),
          nb::arg("threads") = 0,
          nb::sig("def reduce_gradient_into(fine: object, coarse: object, radius: int, "
                  "sigma: float, threads: int = 0) -> None"),
          "The gradient at half resolution.");
    m.def("reduced_differences_into", &reduced_into, nb::arg("volume"), nb::arg("start"),
          nb::arg("shape"), nb::arg("spacing_zyx"), nb::arg("coarse").noconvert(),
          nb::arg("threads") = 0, nb::arg("simd") = true,
          nb::sig("def reduced_differences_into(volume: object, start: tuple[int, int, int], "
                  "shape: tuple[int, int, int], spacing_zyx: tuple[float, float, float], coarse: "
                  "object, threads: int = 0, simd: bool = True) -> int | None"),
          "The reduced gradient of a part; the first that is not finite, or None.");
    m.def("encode_directions_into", &encode_any, nb::arg("vectors"), nb::arg("codes").noconvert(),
          nb::arg("threads") = 0, nb::arg("simd") = true,
          nb::sig("def encode_directions_into(vectors: object, codes: object, threads: int = 0, "
                  "simd: bool = True) -> int | None"),
          "The codes of vectors; the first that is not finite, or None.");
    m.def("decode_directions_into", &decode_into, nb::arg("codes").noconvert(),
          nb::arg("vectors").noconvert(), nb::arg("threads") = 0, nb::arg("simd") = true,
          nb::sig("def decode_directions_into(codes: object, vectors: object, threads: int = 0, "
                  "simd: bool = True) -> None"),
          "The unit vectors of codes.");
}
