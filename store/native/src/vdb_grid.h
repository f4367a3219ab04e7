// One grid of a .vdb file in memory, as the sparse tree that it is.

#ifndef OCTOBRICK_STORE_VDB_GRID_H
#define OCTOBRICK_STORE_VDB_GRID_H

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "vdb_file.h"

namespace octobrick::store {

// A box of index space; x, y, z.
struct IndexBox {
    std::array<std::int32_t, 3> start_xyz{};
    std::array<std::int32_t, 3> shape_xyz{};
};

// Reading is safe from several threads.
class VdbGrid {
  public:
    virtual ~VdbGrid() = default;

    // The smallest box around all active voxels; none if there are none.
    virtual std::optional<IndexBox> active_box() const = 0;
    virtual std::uint64_t active_voxels() const = 0;
    virtual std::uint64_t leaves() const = 0;
    virtual std::uint64_t memory_nbytes() const = 0;
    virtual std::size_t components() const = 0;
    virtual double background(std::size_t component) const = 0;

    // Writes one component of a box into an array [z, y, x] of the grid's type.
    virtual void fill(const IndexBox& box, std::size_t component, void* out) const = 0;

    // The value of all voxels of a box, where no leaf says otherwise.
    virtual std::optional<double> constant(const IndexBox& box, std::size_t component) const = 0;
};

// Whether grids of this type are read: numpy's name for their samples, or null.
const char* sample_type(const std::string& value_type);

// Reads a grid of a file. Throws what list_grids does.
std::unique_ptr<VdbGrid> load_grid(const std::string& path, const VdbFile& file, std::size_t index);

}  // namespace octobrick::store

#endif
