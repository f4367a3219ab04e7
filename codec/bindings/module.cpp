// octobrick.codec._native: the C++ codec for Python. Arrays come as buffers with any strides;
// faults go back as values, which octobrick.codec turns into exceptions that say what to do.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/variant.h>

#include <optional>
#include <tuple>
#include <variant>

#include "bindings.h"
#include "buffer.h"
#include "octobrick/codec/error_stats.h"
#include "octobrick/codec/reduce.h"
#include "octobrick/codec/s3dc.h"
#include "octobrick/codec/upsample.h"
#include "octobrick/codec/value_counts.h"

namespace nb = nanobind;
using namespace octobrick::codec;

namespace {

using Block = std::tuple<std::size_t, std::size_t, std::size_t>;
using Position = Block;

constexpr int kReadStrided = PyBUF_STRIDES | PyBUF_FORMAT;
constexpr int kWriteStrided = kReadStrided | PyBUF_WRITABLE;

S3dc make_codec(const Block& block, unsigned bits, bool fitted, bool scaled) {
    return {{std::get<0>(block), std::get<1>(block), std::get<2>(block)}, bits, fitted, scaled};
}

Outcome failure(Status status) { return {status, {}, 0, 0}; }

std::variant<Outcome, std::tuple<std::size_t, std::size_t>> layout_nbytes(
    const Block& shape, std::size_t sample_nbytes, const Block& block, unsigned bits, bool scaled) {
    const SampleType type = sample_nbytes == 1   ? SampleType::u8
                            : sample_nbytes == 2 ? SampleType::u16
                                                 : SampleType::f32;
    Layout layout;
    const Status status =
        make_layout(make_codec(block, bits, false, scaled), type,
                    {std::get<0>(shape), std::get<1>(shape), std::get<2>(shape)}, layout);
    if (status != Status::ok) {
        return failure(status);
    }
    return std::tuple(layout.end_points_nbytes, layout.nbytes);
}

std::variant<Outcome, nb::bytes> encode_array(nb::handle array, const Block& block, unsigned bits,
                                              unsigned threads, bool simd, bool fitted,
                                              bool scaled) {
    const Buffer buffer(array, kReadStrided);
    const auto voxels = buffer.volume<ConstVolume>();
    const S3dc codec = make_codec(block, bits, fitted, scaled);
    Layout layout;
    if (const Status s = make_layout(codec, voxels.type, voxels.shape, layout); s != Status::ok) {
        return failure(s);
    }
    // A new bytes object that no one else knows may be written, even without the GIL.
    nb::bytes code = nb::steal<nb::bytes>(
        PyBytes_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(layout.nbytes)));
    if (!code.is_valid()) {
        throw nb::python_error();
    }
    auto* out = reinterpret_cast<std::byte*>(PyBytes_AsString(code.ptr()));
    Outcome outcome;
    {
        const nb::gil_scoped_release unlocked;
        outcome = encode(codec, voxels, {out, layout.nbytes}, {threads, simd});
    }
    if (outcome.status != Status::ok) {
        return outcome;
    }
    return code;
}

Outcome decode_into(nb::handle data, nb::handle out, const Block& block, unsigned bits,
                    unsigned threads, bool simd, bool scaled) {
    const Buffer code(data, PyBUF_SIMPLE);
    const Buffer array(out, kWriteStrided);
    const auto voxels = array.volume<Volume>();
    const nb::gil_scoped_release unlocked;
    return decode(make_codec(block, bits, false, scaled), code.bytes(), voxels, {threads, simd});
}

// A function from one volume to another that refuses what does not fit.
using Resample = bool (*)(const ConstVolume&, const Volume&, Execution);

template <Resample resample>
bool resample_into(nb::handle from, nb::handle to, unsigned threads, bool simd) {
    const Buffer source(from, kReadStrided);
    const Buffer target(to, kWriteStrided);
    const auto source_volume = source.volume<ConstVolume>();
    const auto target_volume = target.volume<Volume>();
    const nb::gil_scoped_release unlocked;
    return resample(source_volume, target_volume, {threads, simd});
}

nb::tuple compare_arrays(nb::handle a, nb::handle b, bool simd) {
    const Buffer a_buffer(a, kReadStrided);
    const Buffer b_buffer(b, kReadStrided);
    const auto a_volume = a_buffer.volume<ConstVolume>();
    const auto b_volume = b_buffer.volume<ConstVolume>();
    ErrorStats stats;
    bool comparable;
    {
        const nb::gil_scoped_release unlocked;
        comparable = compare(a_volume, b_volume, stats, {1, simd});
    }
    if (!comparable) {
        throw nb::value_error("expected equal types and shapes");
    }
    if (a_volume.type == SampleType::f32) {
        return nb::make_tuple(stats.count, stats.max_abs_f, stats.squares_f);
    }
    const nb::object squares =
        (nb::int_(stats.squares_high) << nb::int_(64)) | nb::int_(stats.squares);
    return nb::make_tuple(stats.count, stats.max_abs, squares);
}

using Counts = nb::ndarray<std::uint64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

bool count_values_into(nb::handle array, int exponent, std::int64_t first, const Counts& counts,
                       bool simd) {
    const Buffer buffer(array, kReadStrided);
    const auto voxels = buffer.volume<ConstVolume>();
    const int least = voxels.type == SampleType::f32 ? -512 : 0;
    const std::int64_t most = std::int64_t{1} << 53;
    if (exponent < least || exponent > 512 || first < -most || first > most ||
        counts.size() >= std::size_t{1} << 31) {
        throw nb::value_error("bins out of range");
    }
    const nb::gil_scoped_release unlocked;
    return count_values(voxels, exponent, first, {counts.data(), counts.size()}, {1, simd});
}

}  // namespace

NB_MODULE(_native, m) {
    m.doc() = "The C++ codec. Internal: use octobrick.codec.";

    nb::enum_<Status>(m, "Status", "How a call ended; see octobrick/codec/s3dc.h.")
        .value("OK", Status::ok)
        .value("BAD_BITS", Status::bad_bits)
        .value("BAD_BLOCK", Status::bad_block)
        .value("EMPTY_SHAPE", Status::empty_shape)
        .value("TOO_LARGE", Status::too_large)
        .value("WRONG_NBYTES", Status::wrong_nbytes)
        .value("NOT_FINITE", Status::not_finite)
        .value("BAD_END_POINTS", Status::bad_end_points)
        .value("BAD_PADDING", Status::bad_padding)
        .value("BAD_WIDTHS", Status::bad_widths)
        .value("BUDGET_TOO_SMALL", Status::budget_too_small)
        .value("WRONG_PREDICTION", Status::wrong_prediction)
        .value("BAD_GROUPS", Status::bad_groups)
        .value("BAD_RAW", Status::bad_raw)
        .value("BAD_SCALES", Status::bad_scales);

    nb::class_<Outcome>(m, "Outcome", "A status, where, and the two values that it is about.")
        .def_ro("status", &Outcome::status)
        .def_prop_ro("at", [](const Outcome& o) { return Position{o.at.z, o.at.y, o.at.x}; })
        .def_ro("first", &Outcome::first)
        .def_ro("second", &Outcome::second);

    m.def("layout_nbytes", &layout_nbytes, nb::arg("shape"), nb::arg("sample_nbytes"),
          nb::arg("block"), nb::arg("bits"), nb::arg("scaled") = false,
          "Bytes of the end points and of the whole code, or what is wrong.");
    m.def("encode", &encode_array, nb::arg("array"), nb::arg("block"), nb::arg("bits"),
          nb::arg("threads") = 0, nb::arg("simd") = true, nb::arg("fitted") = false,
          nb::arg("scaled") = false, "The code of an array (z, y, x), or what is wrong with it.");
    m.def("decode_into", &decode_into, nb::arg("data"), nb::arg("out"), nb::arg("block"),
          nb::arg("bits"), nb::arg("threads") = 0, nb::arg("simd") = true,
          nb::arg("scaled") = false,
          "Decode into an array (z, y, x) of the voxels' shape and type.");
    m.def("mean2_into", &resample_into<mean2>, nb::arg("fine"), nb::arg("coarse"),
          nb::arg("threads") = 0, nb::arg("simd") = true,
          "Reduce to half the shape, rounded up; False where they do not fit.");
    m.def("upsample2_into", &resample_into<upsample2>, nb::arg("coarse"), nb::arg("fine"),
          nb::arg("threads") = 0, nb::arg("simd") = true,
          "Interpolate to twice the shape; False where they do not fit.");
    m.def(
        "compare", &compare_arrays, nb::arg("a"), nb::arg("b"), nb::arg("simd") = true,
        nb::sig("def compare(a: object, b: object, simd: bool = True) -> tuple[int, float, float]"),
        "Count, max |a - b|, sum of (a - b)^2; whole for integer arrays.");

    m.def("count_values_into", &count_values_into, nb::arg("array"), nb::arg("exponent"),
          nb::arg("first"), nb::arg("counts").noconvert(), nb::arg("simd") = true,
          nb::sig("def count_values_into(array: object, exponent: int, first: int, counts: object, "
                  "simd: bool = True) -> bool"),
          "Add the voxels to bins; False where one has no bin.");

    bind_deblock(m);
    bind_gradients(m);
    bind_s3dc_variable(m);
    bind_s3dc_sampler(m);
    bind_zerobit(m);
}
