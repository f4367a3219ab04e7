// Zerobit for Python. Arrays come as C-contiguous buffers with their shape and sample type; faults
// go back as values, which octobrick.codec.zerobit turns into exceptions.

#include "bindings.h"

#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <optional>
#include <span>
#include <tuple>
#include <variant>

#include "buffer.h"
#include "octobrick/codec/zerobit.h"

namespace nb = nanobind;
using namespace octobrick::codec;

namespace {

using Position = std::tuple<std::size_t, std::size_t, std::size_t>;

Zyx zyx(const Position& p) { return {std::get<0>(p), std::get<1>(p), std::get<2>(p)}; }
Position position(Zyx p) { return {p.z, p.y, p.x}; }

std::size_t count(Zyx shape) { return shape.z * shape.y * shape.x; }

ZerobitVolume volume_of(const Buffer& voxels, const Position& shape, unsigned type,
                        unsigned channels) {
    if (type > static_cast<unsigned>(SampleType::f32)) throw nb::value_error("no such type");
    const ZerobitVolume v{voxels.data(), static_cast<SampleType>(type), channels, zyx(shape)};
    voxels.require_nbytes(count(v.shape) * channels * sample_nbytes(v.type));
    return v;
}

nb::bytes to_bytes(const std::vector<std::byte>& bytes) {
    return nb::bytes(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

std::variant<ZerobitOutcome, nb::bytes> encode(nb::handle voxels, const Position& shape,
                                               unsigned type, unsigned channels,
                                               const ZerobitSettings& settings, nb::handle wanted,
                                               nb::handle codebook, unsigned threads) {
    const Buffer from(voxels), mask(wanted), book(codebook);
    const ZerobitVolume volume = volume_of(from, shape, type, channels);
    const auto cells = [](std::size_t n) { return (n + 3) / 4; };
    if (mask.size() != 0) {
        mask.require_nbytes(cells(volume.shape.z) * cells(volume.shape.y) * cells(volume.shape.x));
    }
    std::vector<std::byte> code;
    ZerobitOutcome outcome;
    {
        const nb::gil_scoped_release unlocked;
        outcome = zerobit_encode(volume, settings,
                                 {reinterpret_cast<const std::uint8_t*>(mask.data()), mask.size()},
                                 book.bytes(), code, threads);
    }
    if (outcome.status != ZerobitStatus::ok) return outcome;
    return to_bytes(code);
}

ZerobitOutcome train(ZerobitTrainer& trainer, nb::handle voxels, const Position& shape,
                     unsigned type, unsigned channels, unsigned threads) {
    const Buffer from(voxels);
    const ZerobitVolume volume = volume_of(from, shape, type, channels);
    const nb::gil_scoped_release unlocked;
    return trainer.add(volume, threads);
}

// A reader and the buffers that it looks at.
class Reader {
  public:
    Reader(nb::handle code, nb::handle codebook) : code_(code), codebook_(codebook) {
        outcome_ = ZerobitReader::open(code_.bytes(), codebook_.bytes(), reader_);
    }

    const ZerobitOutcome& outcome() const { return outcome_; }
    const ZerobitHeader& header() const { return get().header(); }

    ZerobitOutcome check(unsigned threads) const {
        const ZerobitReader& reader = get();
        const nb::gil_scoped_release unlocked;
        return reader.check(threads);
    }

    ZerobitOutcome level(unsigned level, nb::handle out, unsigned threads) const {
        const ZerobitReader& reader = get();
        if (level > 2) throw nb::value_error("levels are 0, 1 and 2");
        const Zyx s = header().shape;
        const std::size_t half = (std::size_t{1} << level) - 1;
        const Buffer to(out, PyBUF_WRITABLE);
        to.require_nbytes(
            count({(s.z + half) >> level, (s.y + half) >> level, (s.x + half) >> level}) * unit());
        const nb::gil_scoped_release unlocked;
        const ZerobitOutcome outcome = reader.check(threads);
        if (outcome.status == ZerobitStatus::ok) reader.level(level, to.data(), threads);
        return outcome;
    }

    ZerobitOutcome voxel(const Position& at, nb::handle out) const {
        const Zyx p = zyx(at);
        return read(p, header().shape, 16, out, 1,
                    [&](std::byte* to) { get().voxels({&p, 1}, to); });
    }

    // Many at once: `at` has three uint64 for each. All unit blocks are checked.
    ZerobitOutcome many_voxels(nb::handle at, nb::handle out) const {
        return read_many(at, header().shape, out, 1,
                         [&](std::span<const Zyx> p, std::byte* to) { get().voxels(p, to); });
    }

    ZerobitOutcome many_cells(nb::handle at, nb::handle out) const {
        return read_many(at, cells(), out, 64,
                         [&](std::span<const Zyx> p, std::byte* to) { get().cells(p, to); });
    }

    ZerobitOutcome plane(const Position& cell, unsigned axis, unsigned offset,
                         nb::handle out) const {
        if (axis > 2 || offset > 3) throw nb::value_error("no such plane");
        return read(zyx(cell), cells(), 4, out, 16,
                    [&](std::byte* to) { get().plane(zyx(cell), axis, offset, to); });
    }

    ZerobitOutcome cell(const Position& cell, nb::handle out) const {
        return read(zyx(cell), cells(), 4, out, 64,
                    [&](std::byte* to) { get().cell(zyx(cell), to); });
    }

    std::vector<float> thresholds() const {
        std::vector<float> all(header().blocks);
        for (std::size_t i = 0; i < all.size(); ++i) all[i] = get().threshold(i);
        return all;
    }

    // After check() alone.
    ZerobitStats stats() const { return get().stats(); }

  private:
    const ZerobitReader& get() const {
        if (reader_ == nullptr) throw nb::value_error("the reader is not open");
        return *reader_;
    }
    std::size_t unit() const { return header().channels * sample_nbytes(header().type); }
    Zyx cells() const {
        const Zyx s = header().shape;
        return {(s.z + 3) / 4, (s.y + 3) / 4, (s.x + 3) / 4};
    }

    template <class F>
    ZerobitOutcome read_many(nb::handle at, Zyx within, nb::handle out, std::size_t voxels,
                             const F& f) const {
        const Buffer from(at), to(out, PyBUF_WRITABLE);
        std::uint64_t p[3];
        std::vector<Zyx> positions(from.size() / sizeof p);
        from.require_nbytes(positions.size() * sizeof p);
        to.require_nbytes(positions.size() * voxels * unit());
        for (std::size_t k = 0; k < positions.size(); ++k) {
            std::memcpy(p, from.data() + k * sizeof p, sizeof p);
            if (p[0] >= within.z || p[1] >= within.y || p[2] >= within.x) {
                throw nb::value_error("outside of the volume");
            }
            positions[k] = {p[0], p[1], p[2]};
        }
        const ZerobitOutcome outcome = get().check();
        if (outcome.status == ZerobitStatus::ok) f(positions, to.data());
        return outcome;
    }

    // Checks the unit block of `at`, `per_block` of which lie in one along each axis; then reads.
    template <class F>
    ZerobitOutcome read(Zyx at, Zyx within, std::size_t per_block, nb::handle out,
                        std::size_t voxels, const F& f) const {
        if (at.z >= within.z || at.y >= within.y || at.x >= within.x) {
            throw nb::value_error("outside of the volume");
        }
        const Buffer to(out, PyBUF_WRITABLE);
        to.require_nbytes(voxels * unit());
        const ZerobitOutcome outcome =
            get().check_block({at.z / per_block, at.y / per_block, at.x / per_block});
        if (outcome.status == ZerobitStatus::ok) f(to.data());
        return outcome;
    }

    Buffer code_, codebook_;
    std::unique_ptr<ZerobitReader> reader_;
    ZerobitOutcome outcome_;
};

std::tuple<std::size_t, std::size_t> pair(const ZerobitOperations& o) {
    return {o.additions, o.decodings};
}

}  // namespace

void bind_zerobit(nb::module_& m) {
    nb::enum_<ZerobitStatus>(m, "ZerobitStatus", "How a call ended; see octobrick/codec/zerobit.h.")
        .value("OK", ZerobitStatus::ok)
        .value("UNSUPPORTED_TYPE", ZerobitStatus::unsupported_type)
        .value("EMPTY_SHAPE", ZerobitStatus::empty_shape)
        .value("TOO_LARGE", ZerobitStatus::too_large)
        .value("NOT_FINITE", ZerobitStatus::not_finite)
        .value("WRONG_CODEBOOK", ZerobitStatus::wrong_codebook)
        .value("BAD_HEADER", ZerobitStatus::bad_header)
        .value("WRONG_NBYTES", ZerobitStatus::wrong_nbytes)
        .value("BAD_BLOCK", ZerobitStatus::bad_block);

    nb::class_<ZerobitOutcome>(m, "ZerobitOutcome", "A status, where, and what it is about.")
        .def_ro("status", &ZerobitOutcome::status)
        .def_prop_ro("at", [](const ZerobitOutcome& o) { return position(o.at); })
        .def_ro("first", &ZerobitOutcome::first)
        .def_ro("second", &ZerobitOutcome::second);

    nb::class_<ZerobitSettings>(m, "ZerobitSettings", "What an encoder keeps.")
        .def(
            "__init__",
            [](ZerobitSettings* self, double ratio, bool global, bool orthonormal,
               bool count_averages, std::optional<std::array<double, 3>> background) {
                new (self) ZerobitSettings{ratio, global, orthonormal, count_averages, background};
            },
            nb::arg("ratio"), nb::arg("global_threshold"), nb::arg("orthonormal"),
            nb::arg("count_averages"), nb::arg("background").none());

    nb::class_<ZerobitTrainer>(m, "ZerobitTrainer", "Gathers colours for a shared codebook.")
        .def(
            "__init__",
            [](ZerobitTrainer* self, unsigned type, unsigned channels,
               const ZerobitSettings& settings) {
                new (self) ZerobitTrainer(static_cast<SampleType>(type), channels, settings);
            },
            nb::arg("sample_type"), nb::arg("channels"), nb::arg("settings"))
        .def("add", &train, nb::arg("voxels"), nb::arg("shape"), nb::arg("sample_type"),
             nb::arg("channels"), nb::arg("threads") = 0)
        .def("codebook", [](const ZerobitTrainer& t) { return to_bytes(t.codebook()); });

    m.def("zerobit_encode", &encode, nb::arg("voxels"), nb::arg("shape"), nb::arg("sample_type"),
          nb::arg("channels"), nb::arg("settings"), nb::arg("wanted"), nb::arg("codebook"),
          nb::arg("threads") = 0, "The code of a C-contiguous array, or what is wrong with it.");

    nb::class_<Reader>(m, "ZerobitReader", "Reads a code; see octobrick/codec/zerobit.h.")
        .def(nb::init<nb::handle, nb::handle>(), nb::arg("code"), nb::arg("codebook"))
        .def_prop_ro("outcome", &Reader::outcome)
        .def_prop_ro("shape", [](const Reader& r) { return position(r.header().shape); })
        .def_prop_ro("grid", [](const Reader& r) { return position(r.header().grid); })
        .def_prop_ro("type", [](const Reader& r) { return static_cast<int>(r.header().type); })
        .def_prop_ro("channels", [](const Reader& r) { return r.header().channels; })
        .def_prop_ro("background",
                     [](const Reader& r) { return std::array<double, 3>(r.header().background); })
        .def_prop_ro("pointers_nbytes", [](const Reader& r) { return 4 * r.header().blocks; })
        .def_prop_ro("codebook_nbytes", [](const Reader& r) { return r.header().codebook_nbytes; })
        .def("check", &Reader::check, nb::arg("threads") = 0)
        .def("level", &Reader::level, nb::arg("level"), nb::arg("out"), nb::arg("threads") = 0)
        .def("voxel", &Reader::voxel, nb::arg("at"), nb::arg("out"))
        .def("voxels", &Reader::many_voxels, nb::arg("at"), nb::arg("out"),
             "Of many positions, uint64 (n, 3).")
        .def("cells", &Reader::many_cells, nb::arg("at"), nb::arg("out"),
             "Of many cells, uint64 (n, 3).")
        .def("plane", &Reader::plane, nb::arg("cell"), nb::arg("axis"), nb::arg("offset"),
             nb::arg("out"))
        .def("cell", &Reader::cell, nb::arg("cell"), nb::arg("out"))
        .def("thresholds", &Reader::thresholds)
        .def("stats", [](const Reader& r) {
            const ZerobitStats s = r.stats();
            return std::tuple(s.cells, s.details, s.null_nodes[0], s.null_nodes[1]);
        });

    m.def(
        "zerobit_voxel_operations",
        [](unsigned z, unsigned y, unsigned x) { return pair(zerobit_voxel_operations(z, y, x)); },
        nb::arg("z"), nb::arg("y"), nb::arg("x"), "Additions and decodings of one voxel.");
    m.def(
        "zerobit_plane_operations",
        [](unsigned axis, unsigned offset) { return pair(zerobit_plane_operations(axis, offset)); },
        nb::arg("axis"), nb::arg("offset"), "Additions and decodings of one plane of a cell.");
    m.def(
        "zerobit_cell_operations", [] { return pair(zerobit_cell_operations()); },
        "Additions and decodings of one cell.");
}
