// The envelope of a .vdb file: header, list of grids, metadata and transforms. It is parsed here
// and not by OpenVDB, whose readers of metadata trust the sizes that a file gives.

#ifndef OCTOBRICK_STORE_VDB_FILE_H
#define OCTOBRICK_STORE_VDB_FILE_H

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace octobrick::store {

// Versions of the file and of the library that wrote it; OpenVDB's readers want both.
struct VdbVersion {
    std::uint32_t file = 0;
    std::uint32_t library_major = 0;
    std::uint32_t library_minor = 0;
};

// Index space to world: world = index · linear + translation, as row vectors (x, y, z).
struct VdbTransform {
    std::string kind;
    bool is_linear = true;  // else the rest is not known, and voxels are not all alike
    std::array<std::array<double, 3>, 3> linear{};
    std::array<double, 3> translation{};
};

// What a file says of a grid before its voxels.
struct VdbGridInfo {
    std::string name;
    std::string value_type;  // "float", "double", "int32", "vec3s", …
    std::string grid_class;  // "level set", "fog volume", … or empty
    std::string instance_of;
    bool is_half = false;
    VdbTransform transform;
    std::map<std::string, std::string> texts;  // metadata that are text
    std::optional<std::array<std::int32_t, 3>> active_min_xyz, active_max_xyz;
    std::optional<std::int64_t> active_voxels;

    std::uint32_t compression = 0;
    std::uint64_t begin = 0;  // in the file
    std::uint64_t end = 0;
    std::uint64_t tree_offset = 0;  // of the tree, from `begin`
};

struct VdbFile {
    VdbVersion version;
    std::vector<VdbGridInfo> grids;
};

struct FileRange {
    std::unique_ptr<char[]> data;
    std::size_t nbytes = 0;
    std::span<const char> bytes() const { return {data.get(), nbytes}; }
};

// Throws Truncated, Damaged, Unsupported; std::system_error if it cannot be opened or read.
VdbFile list_grids(const std::string& path);

// Bytes of a file, in memory; Truncated if there are fewer.
FileRange read_range(const std::string& path, std::uint64_t begin, std::uint64_t end);

}  // namespace octobrick::store

#endif
