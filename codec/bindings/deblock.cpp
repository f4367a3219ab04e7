// Deblocking for Python: all arrays contiguous float32, as octobrick.codec.deblock makes them.

#include "octobrick/codec/deblock.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <optional>
#include <tuple>

#include "bindings.h"
#include "contiguous.h"
#include "octobrick/codec/gradients.h"

namespace nb = nanobind;
using namespace octobrick::codec;

namespace {

using Input = nb::ndarray<const float, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Output = nb::ndarray<float, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Extents = std::tuple<std::size_t, std::size_t, std::size_t>;

template <class A, class B>
bool same_shape(const A& a, const B& b) {
    return a.shape(0) == b.shape(0) && a.shape(1) == b.shape(1) && a.shape(2) == b.shape(2);
}

std::size_t blocks(std::size_t voxels, std::size_t block) { return (voxels - 1) / block + 1; }

std::optional<std::size_t> deblock_into(const Input& volume, const Output& out,
                                        const Extents& block, double strength, double value_range,
                                        const std::tuple<double, double>& whole,
                                        const std::optional<Input>& bounds, bool sequential,
                                        DeblockLimit limit, unsigned threads, bool simd) {
    const auto [bz, by, bx] = block;
    require(volume.size() > 0 && same_shape(volume, out), "expected equal shapes");
    require(bz > 0 && by > 0 && bx > 0, "expected a block of at least one voxel");
    const Zyx shape{volume.shape(0), volume.shape(1), volume.shape(2)};
    std::span<const float> limits;
    if (bounds) {
        const bool per_block = bounds->shape(0) == blocks(shape.z, bz) &&
                               bounds->shape(1) == blocks(shape.y, by) &&
                               bounds->shape(2) == blocks(shape.x, bx);
        require(per_block || same_shape(volume, *bounds), "expected a bound per block or voxel");
        limits = {bounds->data(), bounds->size()};
    }
    const Deblock filter{{bz, by, bx},
                         strength,
                         value_range,
                         std::get<0>(whole),
                         std::get<1>(whole),
                         sequential ? DeblockAxes::sequential : DeblockAxes::average,
                         limit};
    const nb::gil_scoped_release unlocked;
    const std::size_t at = deblock(filter, {volume.data(), volume.size()}, shape, limits,
                                   {out.data(), out.size()}, {threads, simd});
    return at == kAllFinite ? std::nullopt : std::optional(at);
}

}  // namespace

void bind_deblock(nb::module_& m) {
    nb::enum_<DeblockLimit>(m, "DeblockLimit", "How a bound limits a change; see deblock.h.")
        .value("AUTO", DeblockLimit::automatic)
        .value("RAMP", DeblockLimit::ramp)
        .value("CLAMP", DeblockLimit::clamp);
    m.def("deblock_into", &deblock_into, nb::arg("volume").noconvert(), nb::arg("out").noconvert(),
          nb::arg("block"), nb::arg("strength"), nb::arg("value_range"), nb::arg("whole"),
          nb::arg("bounds").noconvert().none(), nb::arg("sequential"), nb::arg("limit"),
          nb::arg("threads") = 0, nb::arg("simd") = true,
          nb::sig("def deblock_into(volume: object, out: object, block: tuple[int, int, int], "
                  "strength: float, value_range: float, whole: tuple[float, float], "
                  "bounds: object | None, sequential: bool, limit: DeblockLimit, threads: int = 0, "
                  "simd: bool = True) -> int | None"),
          "The filtered volume; the first voxel that is not finite, or None.");
}
