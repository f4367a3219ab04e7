// How long it takes to get voxels out of a zerobit code, beside fetching them from an array.
//
//   zerobit_access VOXELS CODE ROUNDS
//
// VOXELS are the raw samples of the volume that CODE (with its own codebook) is of. Every access
// is done in both ways in one process, alternating, on the same positions and into the same kind of
// buffer; medians over the rounds are written as JSON, in nanoseconds per voxel.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "octobrick/codec/zerobit.h"

namespace {

using namespace octobrick::codec;
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

struct Access {
    std::string name;
    std::size_t voxels;
    std::function<void()> array, code;
    std::vector<double> array_ns, code_ns;
};

double time_ns(const std::function<void()>& f, std::size_t voxels) {
    const auto start = std::chrono::steady_clock::now();
    f();
    const std::chrono::duration<double, std::nano> took = std::chrono::steady_clock::now() - start;
    return took.count() / static_cast<double>(voxels);
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

// The volume as an array. Unit is what a voxel takes.
template <std::size_t Unit>
struct Array {
    const std::byte* voxels;
    Zyx shape;

    void fetch(std::size_t z, std::size_t y, std::size_t x, std::byte* out) const {
        std::memcpy(out, voxels + ((z * shape.y + y) * shape.x + x) * Unit, Unit);
    }

    void fetch(const std::vector<Zyx>& at, std::byte* out) const {
        for (const Zyx& p : at) {
            fetch(p.z, p.y, p.x, out);
            out += Unit;
        }
    }

    // Voxels [begin, begin + size), one by one.
    void fetch(Zyx begin, Zyx size, std::byte* out) const {
        for (std::size_t z = begin.z; z < begin.z + size.z; ++z) {
            for (std::size_t y = begin.y; y < begin.y + size.y; ++y) {
                for (std::size_t x = begin.x; x < begin.x + size.x; ++x) {
                    fetch(z, y, x, out);
                    out += Unit;
                }
            }
        }
    }
};

// Voxels on planes through the volume at random angles, row by row, as a slice view asks for them.
std::vector<Zyx> cutting_planes(Zyx shape, std::size_t count, std::mt19937& random) {
    std::normal_distribution<double> normal;
    std::vector<Zyx> at;
    const double extent[3] = {double(shape.z), double(shape.y), double(shape.x)};
    while (at.size() < count) {
        double u[3], v[3], length_u = 0, along = 0, length_v = 0;
        for (int k = 0; k < 3; ++k) u[k] = normal(random), v[k] = normal(random);
        for (int k = 0; k < 3; ++k) length_u += u[k] * u[k];
        for (int k = 0; k < 3; ++k) u[k] /= std::sqrt(length_u);
        for (int k = 0; k < 3; ++k) along += u[k] * v[k];
        for (int k = 0; k < 3; ++k) v[k] -= along * u[k];
        for (int k = 0; k < 3; ++k) length_v += v[k] * v[k];
        for (int k = 0; k < 3; ++k) v[k] /= std::sqrt(length_v);
        for (int i = -256; i < 256; ++i) {
            for (int j = -256; j < 256; ++j) {
                double p[3];
                bool inside = true;
                for (int k = 0; k < 3; ++k) {
                    p[k] = std::floor(extent[k] / 2 + i * v[k] + j * u[k]);
                    inside = inside && p[k] >= 0 && p[k] < extent[k];
                }
                if (inside) at.push_back({std::size_t(p[0]), std::size_t(p[1]), std::size_t(p[2])});
            }
        }
    }
    at.resize(count);
    return at;
}

template <std::size_t Unit>
void measure(const Bytes& voxels, const ZerobitReader& reader, unsigned rounds) {
    constexpr std::size_t kVoxels = 1000000, kCells = 20000;
    const Zyx shape = reader.header().shape;
    const Zyx whole_cells = {shape.z / 4, shape.y / 4, shape.x / 4};
    const Array<Unit> array{voxels.data(), shape};
    std::mt19937 random(1);
    const auto below = [&](std::size_t n) {
        return std::uniform_int_distribution<std::size_t>(0, n - 1)(random);
    };
    const auto random_in = [&](Zyx extent, std::size_t count) {
        std::vector<Zyx> at(count);
        for (Zyx& p : at) p = {below(extent.z), below(extent.y), below(extent.x)};
        return at;
    };
    const std::vector<Zyx> positions = random_in(shape, kVoxels);
    const std::vector<Zyx> slices = cutting_planes(shape, kVoxels, random);
    const std::vector<Zyx> cells = random_in(whole_cells, kCells);
    Bytes out(std::max(kVoxels * Unit, voxels.size()));

    std::vector<Access> accesses;
    const auto points = [&](const char* name, const std::vector<Zyx>& at) {
        accesses.push_back({name,
                            at.size(),
                            [&] { array.fetch(at, out.data()); },
                            [&] { reader.voxels(at, out.data()); },
                            {},
                            {}});
    };
    points("voxel_random", positions);
    points("voxel_cutting_planes", slices);
    for (unsigned axis = 0; axis < 3; ++axis) {
        const std::string names[3] = {"plane_z", "plane_y", "plane_x"};
        accesses.push_back({names[axis],
                            16 * kCells,
                            [&, axis] {
                                for (std::size_t k = 0; k < kCells; ++k) {
                                    Zyx begin = {4 * cells[k].z, 4 * cells[k].y, 4 * cells[k].x};
                                    Zyx size = {4, 4, 4};
                                    std::size_t* const b[3] = {&begin.z, &begin.y, &begin.x};
                                    std::size_t* const s[3] = {&size.z, &size.y, &size.x};
                                    *b[axis] += k % 4;
                                    *s[axis] = 1;
                                    array.fetch(begin, size, out.data() + 16 * k * Unit);
                                }
                            },
                            [&, axis] {
                                for (std::size_t k = 0; k < kCells; ++k) {
                                    reader.plane(cells[k], axis, k % 4, out.data() + 16 * k * Unit);
                                }
                            },
                            {},
                            {}});
    }
    accesses.push_back(
        {"cell",
         64 * kCells,
         [&] {
             for (std::size_t k = 0; k < kCells; ++k) {
                 array.fetch({4 * cells[k].z, 4 * cells[k].y, 4 * cells[k].x}, {4, 4, 4},
                             out.data() + (64 * k * Unit) % (out.size() / 2));
             }
         },
         [&] {
             for (std::size_t k = 0; k < kCells; ++k) {
                 reader.cell(cells[k], out.data() + (64 * k * Unit) % (out.size() / 2));
             }
         },
         {},
         {}});
    accesses.push_back({"volume",
                        voxels.size() / Unit,
                        [&] { array.fetch({}, shape, out.data()); },
                        [&] { reader.level(0, out.data(), 1); },
                        {},
                        {}});

    for (unsigned round = 0; round < rounds; ++round) {
        for (Access& access : accesses) {
            access.array_ns.push_back(time_ns(access.array, access.voxels));
            access.code_ns.push_back(time_ns(access.code, access.voxels));
        }
    }
    const char* separator = "{";
    for (const Access& access : accesses) {
        std::printf("%s\n  \"%s\": {\"array_ns\": %.4f, \"code_ns\": %.4f}", separator,
                    access.name.c_str(), median(access.array_ns), median(access.code_ns));
        separator = ",";
    }
    std::printf("\n}\n");
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 4) {
        std::fprintf(stderr, "usage: zerobit_access VOXELS CODE ROUNDS\n");
        return 2;
    }
    const Bytes voxels = read_file(argv[1]), code = read_file(argv[2]);
    std::unique_ptr<ZerobitReader> reader;
    if (ZerobitReader::open(code, {}, reader).status != ZerobitStatus::ok ||
        reader->check().status != ZerobitStatus::ok) {
        std::fprintf(stderr, "%s is not a zerobit code\n", argv[2]);
        return 1;
    }
    const ZerobitHeader& h = reader->header();
    const std::size_t unit = h.channels * sample_nbytes(h.type);
    if (voxels.size() != h.shape.z * h.shape.y * h.shape.x * unit) {
        std::fprintf(stderr, "%s is not of that shape\n", argv[1]);
        return 1;
    }
    const auto rounds = static_cast<unsigned>(std::max(1, std::atoi(argv[3])));
    switch (unit) {
        case 1: measure<1>(voxels, *reader, rounds); break;
        case 2: measure<2>(voxels, *reader, rounds); break;
        case 3: measure<3>(voxels, *reader, rounds); break;
        case 4: measure<4>(voxels, *reader, rounds); break;
        case 6: measure<6>(voxels, *reader, rounds); break;
    }
    return 0;
}
