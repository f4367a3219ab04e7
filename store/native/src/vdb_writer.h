// A grid that is made of boxes of voxels, one after another, and saved as a .vdb file.

#ifndef OCTOBRICK_STORE_VDB_WRITER_H
#define OCTOBRICK_STORE_VDB_WRITER_H

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "vdb_grid.h"

namespace octobrick::store {

// Values from low to high, both included, are active; NaN is not.
struct ActiveRange {
    double low = 0;
    double high = 0;
};

// How a grid is saved: world = index * spacing + origin.
struct VdbSaving {
    std::string name;
    std::string grid_class;  // "fog volume", "level set" or "unknown"
    std::array<double, 3> spacing_xyz{1, 1, 1};
    std::array<double, 3> origin_xyz{};
    bool half = false;
};

class VdbWriter {
  public:
    virtual ~VdbWriter() = default;

    // Takes over the active ones of an array [z, y, x] of the writer's type that fills a box;
    // without a range all.
    virtual void add(const IndexBox& box, const void* samples,
                     const std::optional<ActiveRange>& active) = 0;
    virtual std::uint64_t active_voxels() const = 0;

    // Makes tiles of what is constant, and writes the file. Throws std::runtime_error.
    virtual void save(const std::string& path, const VdbSaving& saving) = 0;
};

// A writer for a type of samples that sample_type names; Unsupported for others.
std::unique_ptr<VdbWriter> make_writer(const std::string& sample_type, double background);

}  // namespace octobrick::store

#endif
