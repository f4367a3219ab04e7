// The blocks that deblocking works on: where their voxels lie, and which of them stay as they are.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "octobrick/codec/view.h"
#include "parallel.h"

namespace octobrick::codec::detail {

// The grid of blocks, and in which of them a voxel lies.
struct Grid {
    Zyx shape, block, count;
    Grid(Zyx s, Zyx b)
        : shape(s),
          block(b),
          count{(s.z - 1) / b.z + 1, (s.y - 1) / b.y + 1, (s.x - 1) / b.x + 1} {}
    std::size_t cells() const { return count.z * count.y * count.x; }
    std::size_t cell(Zyx at) const { return (at.z * count.y + at.y) * count.x + at.x; }
    Zyx cell_of(Zyx voxel) const {
        return {voxel.z / block.z, voxel.y / block.y, voxel.x / block.x};
    }
};

// A part of a row of voxels that lies in one block.
struct Run {
    std::size_t z, y, x, end;  // [x, end)
    std::size_t first;         // flat index of the voxel at x
    std::size_t cell;
    std::size_t last() const { return first + (end - x); }  // the flat index behind it
};

// Calls body(run) for all voxels, the planes of one layer of blocks on one thread.
template <class Body>
void over_blocks(const Grid& grid, unsigned threads, const Body& body) {
    const Zyx shape = grid.shape;
    parallel_for(grid.count.z, threads, [&](std::size_t layer, unsigned) {
        const std::size_t begin = layer * grid.block.z;
        const std::size_t end = begin + std::min(grid.block.z, shape.z - begin);
        for (std::size_t z = begin; z < end; ++z) {
            for (std::size_t y = 0; y < shape.y; ++y) {
                std::size_t cell = grid.cell({layer, y / grid.block.y, 0});
                const std::size_t row = (z * shape.y + y) * shape.x;
                for (std::size_t x = 0; x < shape.x; ++cell) {
                    const std::size_t stop = x + std::min(grid.block.x, shape.x - x);
                    body(Run{z, y, x, stop, row + x, cell});
                    x = stop;
                }
            }
        }
    });
}

// Which blocks keep all of their voxels, as their bound is 0: curves through two of them need not
// be found.
class Kept {
  public:
    // With a bound per block; without bounds none is kept.
    Kept(const Grid& grid, std::span<const float> bounds) : grid_(grid), bounds_(bounds) {}
    bool operator()(std::size_t cell) const { return !bounds_.empty() && bounds_[cell] == 0; }
    // All of the blocks between these, both included.
    bool all(Zyx first, Zyx last) const {
        if (bounds_.empty()) return false;
        for (std::size_t z = first.z; z <= last.z; ++z) {
            for (std::size_t y = first.y; y <= last.y; ++y) {
                for (std::size_t x = first.x; x <= last.x; ++x) {
                    if (bounds_[grid_.cell({z, y, x})] != 0) return false;
                }
            }
        }
        return true;
    }
    // Whether these and those around them are: then nobody asks for weights in it.
    std::vector<bool> idle() const {
        std::vector<bool> idle(grid_.cells(), false);
        if (bounds_.empty()) return idle;
        const auto around = [](std::size_t i, std::size_t n) {
            return std::pair{i > 0 ? i - 1 : i, std::min(i + 1, n - 1)};
        };
        for (std::size_t z = 0; z < grid_.count.z; ++z) {
            const auto [z0, z1] = around(z, grid_.count.z);
            for (std::size_t y = 0; y < grid_.count.y; ++y) {
                const auto [y0, y1] = around(y, grid_.count.y);
                for (std::size_t x = 0; x < grid_.count.x; ++x) {
                    const auto [x0, x1] = around(x, grid_.count.x);
                    idle[grid_.cell({z, y, x})] = all({z0, y, x}, {z1, y, x}) &&
                                                  all({z, y0, x}, {z, y1, x}) &&
                                                  all({z, y, x0}, {z, y, x1});
                }
            }
        }
        return idle;
    }
    const Grid& grid() const { return grid_; }

  private:
    Grid grid_;
    std::span<const float> bounds_;
};

}  // namespace octobrick::codec::detail
