// How long a sample takes from an S3Dc code, beside the same sample from an array.
//
//   s3dc_sampling VOXELS CODE TYPE NZ NY NX BZ BY BX BITS ROUNDS
//
// VOXELS are raw samples of type TYPE (0 to 4: uint8, int8, uint16, int16, float32), CODE is their
// code; BITS is 0 where each block has a width of its own. Every way of sampling is timed in one
// process, on the same points, alternating; medians over the rounds are written as JSON, in
// nanoseconds per sample. The array is sampled twice: by the templates that sample the code
// ("array": located together, prefetched), and point by point as a simple program does ("loop").

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "interpolation.h"
#include "octobrick/codec/s3dc_sampler.h"
#include "rows.h"

namespace {

using namespace octobrick::codec;
using namespace octobrick::codec::detail;
using Bytes = std::vector<std::byte>;

Bytes read_file(const char* path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    if (!file) {
        std::fprintf(stderr, "cannot read %s\n", path);
        std::exit(1);
    }
    Bytes bytes(static_cast<std::size_t>(file.tellg()));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return bytes;
}

// Processor time of this thread, which other programs on the machine do not add to.
double thread_ns() {
    std::timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return 1e9 * static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec);
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

// The access policy of interpolation.h for samples that lie in an array.
template <class T>
class ArrayAccess {
  public:
    struct One {
        std::size_t at;
    };
    struct Eight {
        std::size_t at;
    };

    ArrayAccess(const std::byte* voxels, Zyx shape)
        : voxels_(voxels),
          step_{shape.x > 1, shape.y > 1, shape.z > 1, 0},
          row_nbytes_(shape.x * sizeof(T)),
          slice_nbytes_(shape.y * row_nbytes_),
          next_row_(shape.y > 1 ? row_nbytes_ : 0),
          next_slice_(shape.z > 1 ? slice_nbytes_ : 0) {}

    const IntFour& step() const { return step_; }
    OCTOBRICK_INLINE One place_one(int x, int y, int z) const {
        const auto at = [](int i) { return static_cast<std::uint32_t>(i); };
        return {at(z) * slice_nbytes_ + at(y) * row_nbytes_ + at(x) * sizeof(T)};
    }
    OCTOBRICK_INLINE void place_eight(const IntFour& v, Eight& place) const {
        place.at = place_one(v[0], v[1], v[2]).at;
    }
    OCTOBRICK_INLINE void prefetch(One place) const { __builtin_prefetch(voxels_ + place.at); }
    OCTOBRICK_INLINE void prefetch(Eight place) const {
        for (const std::size_t slice : {std::size_t{0}, next_slice_}) {
            __builtin_prefetch(voxels_ + place.at + slice);
            __builtin_prefetch(voxels_ + place.at + slice + next_row_);
        }
    }
    void look_up(One) const {}
    void look_up(Eight) const {}
    OCTOBRICK_INLINE double one(One place) const {
        T value;
        std::memcpy(&value, voxels_ + place.at, sizeof value);
        return static_cast<double>(value);
    }
    OCTOBRICK_INLINE void eight(Eight place, Corners& corners) const {
        four(place.at, corners.low);
        four(place.at + (step_[0] ? sizeof(T) : 0), corners.high);
    }

  private:
    OCTOBRICK_INLINE void four(std::size_t at, DoubleFour& out) const {
        out = DoubleFour{one({at}), one({at + next_slice_}), one({at + next_row_}),
                         one({at + next_row_ + next_slice_})};
    }

    const std::byte* voxels_;
    IntFour step_;
    std::size_t row_nbytes_, slice_nbytes_, next_row_, next_slice_;
};

// Compiled for the instructions that the sampler of the code has.
template <template <class> class How, class T>
OCTOBRICK_BITS_TARGET void sample_array(const ArrayAccess<T>& access, const SampleAxes& axes,
                                        const std::vector<float>& points, float* out) {
    DoubleFour some[kTogether];
    for (std::size_t first = 0; first < points.size() / 3; first += kTogether) {
        const std::size_t n = std::min(kTogether, points.size() / 3 - first);
        load_points(points.data() + 3 * first, n, some);
        sample_points<How>(access, axes, some, n, out + first);
    }
}

template <class T>
OCTOBRICK_BITS_TARGET void loop_nearest(const ArrayAccess<T>& access, const SampleAxes& axes,
                                        const std::vector<float>& points, float* out) {
    for (std::size_t k = 0; k < points.size(); k += 3) {
        Position at;
        axes.nearest(DoubleFour{points[k], points[k + 1], points[k + 2]}, at);
        const auto voxel = access.place_one(at.low[0], at.low[1], at.low[2]);
        *out++ = static_cast<float>(access.one(voxel));
    }
}

template <class T>
OCTOBRICK_BITS_TARGET void loop_trilinear(const ArrayAccess<T>& access, const SampleAxes& axes,
                                          const std::vector<float>& points, float* out) {
    for (std::size_t k = 0; k < points.size(); k += 3) {
        Position at;
        typename ArrayAccess<T>::Eight place;
        Corners corners = {};
        axes.between(DoubleFour{points[k], points[k + 1], points[k + 2]}, at);
        access.place_eight(at.low, place);
        access.eight(place, corners);
        *out++ = static_cast<float>(interpolate(corners, at));
    }
}

std::vector<float> random_points(Zyx shape, std::size_t count, std::mt19937& random) {
    const float extent[3] = {static_cast<float>(shape.x), static_cast<float>(shape.y),
                             static_cast<float>(shape.z)};
    std::vector<float> points(3 * count);
    for (std::size_t k = 0; k < points.size(); ++k) {
        points[k] = std::uniform_real_distribution<float>(0, extent[k % 3])(random);
    }
    return points;
}

// Along parallel rays through the volume, half a voxel apart, one ray after the other: tiles of
// 32 x 32 rays, a voxel apart, in random directions and through random voxels.
std::vector<float> ray_points(Zyx shape, std::size_t count, std::mt19937& random) {
    using Vector = std::array<double, 3>;
    const Vector extent = {double(shape.x), double(shape.y), double(shape.z)};
    std::normal_distribution<double> normal;
    const auto unit = [](Vector v) {
        const double length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        return Vector{v[0] / length, v[1] / length, v[2] / length};
    };
    const auto cross = [](const Vector& a, const Vector& b) {
        return Vector{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                      a[0] * b[1] - a[1] * b[0]};
    };
    std::vector<float> points;
    while (points.size() < 3 * count) {
        const Vector along = unit({normal(random), normal(random), normal(random)});
        const Vector right = unit(cross(along, {normal(random), normal(random), normal(random)}));
        const Vector up = cross(along, right);
        Vector middle;
        for (int a = 0; a < 3; ++a) {
            middle[a] = std::uniform_real_distribution<double>(0, extent[a])(random);
        }
        const double half = (extent[0] + extent[1] + extent[2]) / 2;
        for (int ray = 0; ray < 32 * 32; ++ray) {
            for (double t = -half; t < half; t += 0.5) {
                Vector p;
                bool inside = true;
                for (int a = 0; a < 3; ++a) {
                    p[a] = middle[a] + t * along[a] + (ray % 32) * right[a] + (ray / 32) * up[a];
                    inside = inside && p[a] >= 0 && p[a] < extent[a];
                }
                if (inside) points.insert(points.end(), {float(p[0]), float(p[1]), float(p[2])});
            }
        }
    }
    points.resize(3 * count);
    return points;
}

struct Access {
    std::string name;
    std::function<void(float*)> run;
    std::vector<double> ns;
};

template <class T>
std::vector<Access> accesses(const S3dcSampler& sampler, const ArrayAccess<T>& array,
                             const SampleAxes& axes, const std::vector<float>& points) {
    const SamplePoints at{std::span<const float>(points)};
    const auto code = [&sampler, at](Sampling how) {
        return [&sampler, at, how](float* out) { sampler.sample(how, at, out); };
    };
    return {
        {"nearest_code", code(Sampling::nearest), {}},
        {"nearest_array",
         [&](float* out) { sample_array<NearestOf>(array, axes, points, out); },
         {}},
        {"nearest_loop", [&](float* out) { loop_nearest(array, axes, points, out); }, {}},
        {"trilinear_code", code(Sampling::trilinear), {}},
        {"trilinear_shared_code", code(Sampling::trilinear_shared), {}},
        {"trilinear_array",
         [&](float* out) { sample_array<TrilinearSharedOf>(array, axes, points, out); },
         {}},
        {"trilinear_loop", [&](float* out) { loop_trilinear(array, axes, points, out); }, {}},
    };
}

template <class T>
void measure(const Bytes& voxels, const S3dcSampler& sampler, Zyx shape, unsigned rounds) {
    constexpr std::size_t kPoints = 1000000;
    std::mt19937 random(1);
    const ArrayAccess<T> array(voxels.data(), shape);
    const SampleAxes axes(shape);
    const std::vector<float> sets[2] = {random_points(shape, kPoints, random),
                                        ray_points(shape, kPoints, random)};
    const char* names[2] = {"random", "rays"};
    std::vector<float> out(kPoints);
    std::vector<Access> all[2];
    for (int s = 0; s < 2; ++s) all[s] = accesses(sampler, array, axes, sets[s]);
    for (unsigned round = 0; round <= rounds; ++round) {  // the first one warms up
        for (auto& set : all) {
            for (Access& access : set) {
                const double start = thread_ns();
                access.run(out.data());
                if (round > 0) access.ns.push_back((thread_ns() - start) / kPoints);
            }
        }
    }
    const char* separator = "{";
    for (int s = 0; s < 2; ++s) {
        for (const Access& access : all[s]) {
            std::printf("%s\n  \"%s_%s\": %.3f", separator, access.name.c_str(), names[s],
                        median(access.ns));
            separator = ",";
        }
    }
    std::printf("\n}\n");
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 12) {
        std::fprintf(stderr,
                     "usage: s3dc_sampling VOXELS CODE TYPE NZ NY NX BZ BY BX BITS ROUNDS\n");
        return 2;
    }
    std::size_t numbers[9];
    for (int k = 0; k < 9; ++k) numbers[k] = std::strtoull(argv[k + 3], nullptr, 10);
    const auto [type_number, nz, ny, nx, bz, by, bx, bits, rounds] = numbers;
    if (type_number > static_cast<std::size_t>(SampleType::f32)) return 2;
    const auto type = static_cast<SampleType>(type_number);
    const Zyx shape = {nz, ny, nx};
    const Bytes voxels = read_file(argv[1]), code = read_file(argv[2]);
    std::unique_ptr<S3dcSampler> sampler;
    const S3dc codec = {{bz, by, bx}, static_cast<unsigned>(bits)};
    const Outcome opened =
        bits != 0 ? S3dcSampler::open(codec, type, shape, code, sampler)
                  : S3dcSampler::open_variable(codec.block, type, shape, code, sampler);
    if (opened.status != Status::ok) {
        std::fprintf(stderr, "%s is not such a code\n", argv[2]);
        return 1;
    }
    if (voxels.size() != nz * ny * nx * sample_nbytes(type)) {
        std::fprintf(stderr, "%s is not of that shape\n", argv[1]);
        return 1;
    }
    with_sample_type(type, [&]<class T>(T) {
        measure<T>(voxels, *sampler, shape, std::max(1u, static_cast<unsigned>(rounds)));
    });
    return 0;
}
