// The volume as an array, and the positions that it is asked for.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstring>
#include <random>
#include <vector>

#include "octobrick/codec/zerobit.h"

namespace octobrick::bench {

using codec::Zyx;

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

    // The voxels of a cell, four at a time.
    void copy_cell(Zyx cell, std::byte* out) const {
        for (std::size_t z = 4 * cell.z; z < 4 * cell.z + 4; ++z) {
            for (std::size_t y = 4 * cell.y; y < 4 * cell.y + 4; ++y, out += 4 * Unit) {
                std::memcpy(out, voxels + ((z * shape.y + y) * shape.x + 4 * cell.x) * Unit,
                            4 * Unit);
            }
        }
    }
};

// Voxels on planes through the volume at random angles, row by row, as a slice view asks for them.
inline std::vector<Zyx> cutting_planes(Zyx shape, std::size_t count, std::mt19937& random) {
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

}  // namespace octobrick::bench
