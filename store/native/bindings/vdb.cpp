// octobrick.store._vdb: OpenVDB grids for Python. Arrays are contiguous and of the grid's type, as
// octobrick.store makes them; faults are exceptions, which octobrick.store words for the user.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <stdexcept>

#include "faults.h"
#include "vdb_file.h"
#include "vdb_grid.h"
#include "vdb_writer.h"

namespace nb = nanobind;
using namespace octobrick::store;

namespace {

using Xyz = std::array<std::int32_t, 3>;
using Output = nb::ndarray<nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Input = nb::ndarray<nb::ro, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

// Farther out, sums of coordinates would leave 32 bits.
constexpr std::int64_t kFarthest = std::int64_t{1} << 30;

IndexBox box_at(const Xyz& start, std::size_t nz, std::size_t ny, std::size_t nx) {
    const std::array<std::size_t, 3> sizes{nx, ny, nz};
    IndexBox box{start, {}};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        if (sizes[axis] == 0 || sizes[axis] > kFarthest || start[axis] < -2 * kFarthest ||
            start[axis] + static_cast<std::int64_t>(sizes[axis]) > kFarthest + 4096) {
            throw std::invalid_argument("a box that is empty or too far from index 0");
        }
        box.shape_xyz[axis] = static_cast<std::int32_t>(sizes[axis]);
    }
    return box;
}

template <class Array>
IndexBox box_of(const Array& array, const Xyz& start) {
    return box_at(start, array.shape(0), array.shape(1), array.shape(2));
}

nb::dlpack::dtype dtype_of(const std::string& sample_type) {
    if (sample_type == "float32") return nb::dtype<float>();
    if (sample_type == "float64") return nb::dtype<double>();
    if (sample_type == "int32") return nb::dtype<std::int32_t>();
    if (sample_type == "int64") return nb::dtype<std::int64_t>();
    return nb::dtype<bool>();
}

// A grid or a writer with the type of its samples, which arrays must have.
struct Grid {
    std::unique_ptr<VdbGrid> grid;
    std::string sample_type;
};

struct Writer {
    std::unique_ptr<VdbWriter> writer;
    std::string sample_type;
};

template <class Array>
void require_type(const Array& array, const std::string& sample_type) {
    if (array.dtype() != dtype_of(sample_type)) {
        throw std::invalid_argument("expected an array of " + sample_type);
    }
}

void require_component(const Grid& self, std::size_t component) {
    if (component >= self.grid->components()) throw std::invalid_argument("no such component");
}

void bind_info(nb::module_& m) {
    nb::class_<VdbTransform>(m, "Transform", "world = index · linear + translation, in x, y, z.")
        .def_ro("kind", &VdbTransform::kind)
        .def_ro("is_linear", &VdbTransform::is_linear)
        .def_ro("linear", &VdbTransform::linear)
        .def_ro("translation", &VdbTransform::translation);
    nb::class_<VdbGridInfo>(m, "GridInfo", "What a file says of a grid before its voxels.")
        .def_ro("name", &VdbGridInfo::name)
        .def_ro("value_type", &VdbGridInfo::value_type)
        .def_prop_ro("sample_type",
                     [](const VdbGridInfo& self) -> std::optional<std::string> {
                         const char* type = sample_type(self.value_type);
                         return type ? std::optional<std::string>(type) : std::nullopt;
                     })
        .def_ro("is_half", &VdbGridInfo::is_half)
        .def_ro("grid_class", &VdbGridInfo::grid_class)
        .def_ro("instance_of", &VdbGridInfo::instance_of)
        .def_ro("transform", &VdbGridInfo::transform)
        .def_ro("active_min_xyz", &VdbGridInfo::active_min_xyz)
        .def_ro("active_max_xyz", &VdbGridInfo::active_max_xyz)
        .def_ro("active_voxels", &VdbGridInfo::active_voxels);
    nb::class_<VdbFile>(m, "File", "The grids of a file, in the order of the file.")
        .def_ro("grids", &VdbFile::grids);
    m.def("list_grids", &list_grids, nb::arg("path"), nb::call_guard<nb::gil_scoped_release>(),
          "What a file says of its grids; no voxel is read.");
}

void bind_grid(nb::module_& m) {
    nb::class_<Grid>(m, "Grid", "One grid in memory, as a sparse tree; any thread may read.")
        .def_ro("sample_type", &Grid::sample_type)
        .def_prop_ro("components", [](const Grid& self) { return self.grid->components(); })
        .def_prop_ro("active_voxels", [](const Grid& self) { return self.grid->active_voxels(); })
        .def_prop_ro("leaves", [](const Grid& self) { return self.grid->leaves(); })
        .def_prop_ro("memory_nbytes", [](const Grid& self) { return self.grid->memory_nbytes(); })
        .def(
            "background",
            [](const Grid& self, std::size_t component) {
                require_component(self, component);
                return self.grid->background(component);
            },
            nb::arg("component") = 0)
        .def(
            "active_box",
            [](const Grid& self) -> std::optional<std::pair<Xyz, Xyz>> {
                const auto box = self.grid->active_box();
                if (!box) return std::nullopt;
                return std::pair(box->start_xyz, box->shape_xyz);
            },
            "Start and shape (x, y, z) of the box of all active voxels.")
        .def(
            "fill",
            [](const Grid& self, const Output& out, const Xyz& start_xyz, std::size_t component) {
                require_type(out, self.sample_type);
                require_component(self, component);
                const IndexBox box = box_of(out, start_xyz);
                const nb::gil_scoped_release unlocked;
                self.grid->fill(box, component, out.data());
            },
            nb::arg("out").noconvert(), nb::arg("start_xyz"), nb::arg("component") = 0,
            nb::sig("def fill(self, out: object, start_xyz: tuple[int, int, int], "
                    "component: int = 0) -> None"),
            "Writes the box that begins at an index into an array [z, y, x].")
        .def(
            "constant",
            [](const Grid& self, const Xyz& start_xyz, const Xyz& shape_xyz,
               std::size_t component) {
                require_component(self, component);
                const auto size = [&](int axis) {
                    return static_cast<std::size_t>(std::max(shape_xyz[axis], 0));
                };
                const IndexBox box = box_at(start_xyz, size(2), size(1), size(0));
                const nb::gil_scoped_release unlocked;
                return self.grid->constant(box, component);
            },
            nb::arg("start_xyz"), nb::arg("shape_xyz"), nb::arg("component") = 0,
            nb::sig("def constant(self, start_xyz: tuple[int, int, int], "
                    "shape_xyz: tuple[int, int, int], component: int = 0) -> float | None"),
            "The value of all voxels of a box that meets no leaf and has one value.");
    m.def(
        "load_grid",
        [](const std::string& path, const VdbFile& file, std::size_t index) {
            const nb::gil_scoped_release unlocked;
            auto grid = load_grid(path, file, index);
            return Grid{std::move(grid), sample_type(file.grids.at(index).value_type)};
        },
        nb::arg("path"), nb::arg("file"), nb::arg("index"), "Reads one grid of a file.");
}

void bind_writer(nb::module_& m) {
    nb::class_<Writer>(m, "Writer", "Makes a grid of boxes of voxels; one thread at a time.")
        .def(
            "__init__",
            [](Writer* self, const std::string& sample_type, double background) {
                new (self) Writer{make_writer(sample_type, background), sample_type};
            },
            nb::arg("sample_type"), nb::arg("background"))
        .def_prop_ro("active_voxels",
                     [](const Writer& self) { return self.writer->active_voxels(); })
        .def(
            "add",
            [](Writer& self, const Input& voxels, const Xyz& start_xyz,
               const std::optional<std::pair<double, double>>& active) {
                require_type(voxels, self.sample_type);
                const IndexBox box = box_of(voxels, start_xyz);
                std::optional<ActiveRange> range;
                if (active) range = ActiveRange{active->first, active->second};
                const nb::gil_scoped_release unlocked;
                self.writer->add(box, voxels.data(), range);
            },
            nb::arg("voxels").noconvert(), nb::arg("start_xyz"), nb::arg("active").none(),
            nb::sig("def add(self, voxels: object, start_xyz: tuple[int, int, int], "
                    "active: tuple[float, float] | None) -> None"),
            "Takes over the voxels of an array [z, y, x] from low to high, or all.")
        .def(
            "save",
            [](Writer& self, const std::string& path, const std::string& name,
               const std::string& grid_class, const std::array<double, 3>& spacing_xyz,
               const std::array<double, 3>& origin_xyz, bool half) {
                const nb::gil_scoped_release unlocked;
                self.writer->save(path, {name, grid_class, spacing_xyz, origin_xyz, half});
            },
            nb::arg("path"), nb::arg("name"), nb::arg("grid_class"), nb::arg("spacing_xyz"),
            nb::arg("origin_xyz"), nb::arg("half"),
            nb::sig("def save(self, path: str, name: str, grid_class: str, "
                    "spacing_xyz: tuple[float, float, float], "
                    "origin_xyz: tuple[float, float, float], half: bool) -> None"),
            "Makes tiles of what is constant and writes the file.");
}

}  // namespace

NB_MODULE(_vdb, m) {
    m.doc() = "OpenVDB grids: read as sparse trees, written from boxes of voxels.";
    nb::exception<Damaged>(m, "DamagedError", PyExc_RuntimeError);
    nb::exception<Truncated>(m, "TruncatedError", PyExc_EOFError);
    nb::exception<Unsupported>(m, "UnsupportedError", PyExc_ValueError);
    bind_info(m);
    bind_grid(m);
    bind_writer(m);
}
