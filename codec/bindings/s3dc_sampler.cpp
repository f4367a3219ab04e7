// Sampling of S3Dc codes for Python: points are contiguous (n, 3) of float32 or float64, samples
// contiguous float32, as octobrick.codec.s3dc_sampler makes them.

#include "octobrick/codec/s3dc_sampler.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <optional>
#include <tuple>

#include "bindings.h"
#include "buffer.h"
#include "contiguous.h"

namespace nb = nanobind;
using namespace octobrick::codec;

namespace {

using Triple = std::tuple<std::size_t, std::size_t, std::size_t>;
using Spacing = std::tuple<double, double, double>;
using Points = nb::ndarray<nb::ro, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Samples = nb::ndarray<float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Vectors = nb::ndarray<float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

Zyx zyx(const Triple& t) { return {std::get<0>(t), std::get<1>(t), std::get<2>(t)}; }

SamplePoints points_of(const Points& array) {
    const std::size_t n = 3 * array.shape(0);
    if (array.dtype() == nb::dtype<float>()) {
        return SamplePoints(std::span(static_cast<const float*>(array.data()), n));
    }
    if (array.dtype() == nb::dtype<double>()) {
        return SamplePoints(std::span(static_cast<const double*>(array.data()), n));
    }
    throw nb::type_error("expected points of native float32 or float64");
}

// A sampler and the buffer that it looks at.
class Sampler {
  public:
    // Without bits, of a code with a width per block.
    Sampler(nb::handle code, const Triple& shape, unsigned type, const Triple& block,
            std::optional<unsigned> bits, bool simd)
        : code_(code) {
        require(type <= static_cast<unsigned>(SampleType::f32), "no such type");
        const nb::gil_scoped_release unlocked;
        const auto sample_type = static_cast<SampleType>(type);
        outcome_ = bits ? S3dcSampler::open({zyx(block), *bits}, sample_type, zyx(shape),
                                            code_.bytes(), sampler_, simd)
                        : S3dcSampler::open_variable(zyx(block), sample_type, zyx(shape),
                                                     code_.bytes(), sampler_, simd);
    }

    const Outcome& outcome() const { return outcome_; }

    void sample(Sampling how, const Points& points, const Samples& out) const {
        const S3dcSampler& sampler = get();
        require(out.shape(0) == points.shape(0), "expected a sample for each point");
        const SamplePoints at = points_of(points);
        const nb::gil_scoped_release unlocked;
        sampler.sample(how, at, out.data());
    }

    void gradient(Sampling how, const Points& points, const Spacing& spacing_zyx,
                  const Vectors& out) const {
        const S3dcSampler& sampler = get();
        require(out.shape(0) == points.shape(0), "expected a vector for each point");
        require(how != Sampling::nearest, "a gradient is that of trilinear samples");
        const SamplePoints at = points_of(points);
        const auto [sz, sy, sx] = spacing_zyx;
        const nb::gil_scoped_release unlocked;
        sampler.gradient(how, at, {sz, sy, sx}, out.data());
    }

    std::tuple<std::uint64_t, std::uint64_t> count_fetches(Sampling how,
                                                           const Points& points) const {
        const S3dcFetches fetches = get().count_fetches(how, points_of(points));
        return {fetches.end_points, fetches.words};
    }

  private:
    const S3dcSampler& get() const {
        require(sampler_ != nullptr, "the sampler is not open");
        return *sampler_;
    }

    Buffer code_;
    std::unique_ptr<S3dcSampler> sampler_;
    Outcome outcome_;
};

}  // namespace

void bind_s3dc_sampler(nb::module_& m) {
    nb::enum_<Sampling>(m, "Sampling", "How a point is sampled; see s3dc_sampler.h.")
        .value("NEAREST", Sampling::nearest)
        .value("TRILINEAR", Sampling::trilinear)
        .value("TRILINEAR_SHARED", Sampling::trilinear_shared);

    nb::class_<Sampler>(m, "S3dcSampler", "Samples a code; see octobrick/codec/s3dc_sampler.h.")
        .def(nb::init<nb::handle, const Triple&, unsigned, const Triple&, std::optional<unsigned>,
                      bool>(),
             nb::arg("code"), nb::arg("shape"), nb::arg("sample_type"), nb::arg("block"),
             nb::arg("bits").none(), nb::arg("simd") = true)
        .def_prop_ro("outcome", &Sampler::outcome)
        .def("sample", &Sampler::sample, nb::arg("how"), nb::arg("points").noconvert(),
             nb::arg("out").noconvert(),
             nb::sig("def sample(self, how: Sampling, points: object, out: object) -> None"))
        .def("gradient", &Sampler::gradient, nb::arg("how"), nb::arg("points").noconvert(),
             nb::arg("spacing_zyx"), nb::arg("out").noconvert(),
             nb::sig("def gradient(self, how: Sampling, points: object, "
                     "spacing_zyx: tuple[float, float, float], out: object) -> None"))
        .def("count_fetches", &Sampler::count_fetches, nb::arg("how"),
             nb::arg("points").noconvert(),
             nb::sig("def count_fetches(self, how: Sampling, points: object) -> tuple[int, int]"),
             "Pairs of end points, and words of indices.");
}
