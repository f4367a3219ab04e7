// Variable-rate S3Dc for Python. Faults go back as values, as in module.cpp.

#include "octobrick/codec/s3dc_variable.h"

#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/variant.h>

#include <optional>
#include <tuple>
#include <variant>
#include <vector>

#include "bindings.h"
#include "buffer.h"

namespace nb = nanobind;
using namespace octobrick::codec;

namespace {

using Block = std::tuple<std::size_t, std::size_t, std::size_t>;
constexpr int kReadStrided = PyBUF_STRIDES | PyBUF_FORMAT;

Zyx zyx(const Block& block) { return {std::get<0>(block), std::get<1>(block), std::get<2>(block)}; }

// A prediction for as long as this lives, or none.
class Prediction {
  public:
    explicit Prediction(nb::handle array) {
        if (array.is_none()) return;
        buffer_.emplace(array, kReadStrided);
        volume_ = buffer_->volume<ConstVolume>();
    }
    const ConstVolume* get() const { return buffer_ ? &volume_ : nullptr; }

  private:
    std::optional<Buffer> buffer_;
    ConstVolume volume_;
};

std::variant<Outcome, nb::bytes> encode_array(nb::handle array, const Block& block,
                                              WidthRule::Kind kind, double value, bool fitted,
                                              nb::handle prediction, unsigned threads, bool simd) {
    const Buffer buffer(array, kReadStrided);
    const Prediction predicted(prediction);
    const auto voxels = buffer.volume<ConstVolume>();
    std::vector<std::byte> code;
    Outcome outcome;
    {
        const nb::gil_scoped_release unlocked;
        outcome = encode_variable({zyx(block), {kind, value}, fitted}, voxels, predicted.get(),
                                  code, {threads, simd});
    }
    if (outcome.status != Status::ok) return outcome;
    return nb::bytes(code.data(), code.size());
}

Outcome decode_into(nb::handle data, nb::handle out, const Block& block, nb::handle prediction,
                    unsigned threads, bool simd) {
    const Buffer code(data, PyBUF_SIMPLE);
    const Buffer array(out, kReadStrided | PyBUF_WRITABLE);
    const Prediction predicted(prediction);
    const auto voxels = array.volume<Volume>();
    const nb::gil_scoped_release unlocked;
    return decode_variable(zyx(block), code.bytes(), predicted.get(), voxels, {threads, simd});
}

// Where groups, flags and payload begin, and the bytes of a unit; or what is wrong.
std::variant<Outcome, std::tuple<std::size_t, std::size_t, std::size_t, std::size_t>> layout_of(
    const Block& shape, std::size_t sample_nbytes, const Block& block, bool predicted) {
    const SampleType type = sample_nbytes == 1   ? SampleType::u8
                            : sample_nbytes == 2 ? SampleType::u16
                                                 : SampleType::f32;
    VariableLayout layout;
    const Status status = make_variable_layout(zyx(block), type, zyx(shape), predicted, layout);
    if (status != Status::ok) return Outcome{status, {}, 0, 0};
    return std::tuple(layout.groups_begin, layout.flags_begin, layout.payload_begin,
                      layout.unit_nbytes);
}

Outcome add_volume(SlopeFinder& finder, nb::handle array, nb::handle prediction, unsigned threads) {
    const Buffer buffer(array, kReadStrided);
    const Prediction predicted(prediction);
    const auto voxels = buffer.volume<ConstVolume>();
    const nb::gil_scoped_release unlocked;
    return finder.add(voxels, predicted.get(), {threads, true});
}

}  // namespace

void bind_s3dc_variable(nb::module_& m) {
    nb::enum_<WidthRule::Kind>(m, "WidthRule", "How widths are chosen; see s3dc_variable.h.")
        .value("SAME", WidthRule::Kind::same)
        .value("BOUND", WidthRule::Kind::bound)
        .value("BUDGET", WidthRule::Kind::budget)
        .value("SLOPE", WidthRule::Kind::slope);
    m.def("variable_encode", &encode_array, nb::arg("array"), nb::arg("block"), nb::arg("rule"),
          nb::arg("value"), nb::arg("fitted"), nb::arg("prediction").none(), nb::arg("threads") = 0,
          nb::arg("simd") = true, "The code of an array (z, y, x), or what is wrong with it.");
    m.def("variable_decode_into", &decode_into, nb::arg("data"), nb::arg("out"), nb::arg("block"),
          nb::arg("prediction").none(), nb::arg("threads") = 0, nb::arg("simd") = true,
          "Decode into an array (z, y, x) of the voxels' shape and type.");
    m.def("variable_layout", &layout_of, nb::arg("shape"), nb::arg("sample_nbytes"),
          nb::arg("block"), nb::arg("predicted"),
          "Where groups, flags and payload begin; bytes of a unit; or a fault.");
    nb::class_<SlopeFinder>(m, "SlopeFinder", "One slope for many volumes; see s3dc_variable.h.")
        .def(
            "__init__",
            [](SlopeFinder* self, const Block& block, bool fitted, unsigned sample_type) {
                new (self)
                    SlopeFinder({zyx(block), {}, fitted}, static_cast<SampleType>(sample_type));
            },
            nb::arg("block"), nb::arg("fitted"), nb::arg("sample_type"))
        .def("add", &add_volume, nb::arg("array"), nb::arg("prediction").none(),
             nb::arg("threads") = 0)
        .def("slope", &SlopeFinder::slope, nb::arg("bits_per_voxel"));
}
