#include "vdb_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <system_error>

#include "cursor.h"
#include "faults.h"

namespace octobrick::store {

namespace {

constexpr std::uint64_t kMagic = 0x56444220;
// Masks tell which values of a node are stored from this version on (2013).
constexpr std::uint32_t kOldestVersion = 222;
constexpr std::uint32_t kNewestVersion = 224;
constexpr std::size_t kUuidNbytes = 36;
// Each grid costs a look into the file; scenes have tens.
constexpr std::int32_t kMostGrids = 65536;
constexpr std::uint64_t kFirstWindowNbytes = 1 << 16;

class OpenFile {
  public:
    explicit OpenFile(const std::string& path)
        : descriptor_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
        struct stat status;
        if (descriptor_ < 0 || ::fstat(descriptor_, &status) != 0) fail();
        nbytes_ = static_cast<std::uint64_t>(status.st_size);
    }
    OpenFile(const OpenFile&) = delete;
    OpenFile& operator=(const OpenFile&) = delete;
    ~OpenFile() {
        if (descriptor_ >= 0) ::close(descriptor_);
    }

    std::uint64_t nbytes() const { return nbytes_; }

    FileRange read(std::uint64_t begin, std::uint64_t end) const {
        if (begin > end || end > nbytes_) {
            throw Truncated("bytes " + std::to_string(begin) + " to " + std::to_string(end) +
                            " are needed, the file has " + std::to_string(nbytes_));
        }
        FileRange range{std::unique_ptr<char[]>(new char[end - begin]), end - begin};
        std::size_t done = 0;
        while (done < range.nbytes) {
            const auto got = ::pread(descriptor_, range.data.get() + done, range.nbytes - done,
                                     static_cast<off_t>(begin + done));
            if (got < 0 && errno == EINTR) continue;
            if (got < 0) fail();
            if (got == 0) throw Truncated("the file became shorter while it was read");
            done += static_cast<std::size_t>(got);
        }
        return range;
    }

  private:
    [[noreturn]] static void fail() { throw std::system_error(errno, std::generic_category()); }

    int descriptor_;
    std::uint64_t nbytes_ = 0;
};

// Parses from a place whose length is not known before: with a window that grows until it suffices.
template <class Parse>
auto parse_at(const OpenFile& file, std::uint64_t begin, std::uint64_t end, Parse parse) {
    if (begin > end) throw Truncated("a grid begins behind its end");
    for (std::uint64_t window = kFirstWindowNbytes;; window *= 8) {
        const std::uint64_t stop = std::min(end, begin + window);
        const FileRange range = file.read(begin, stop);
        Cursor cursor(range.bytes());
        try {
            return parse(cursor);
        } catch (const Truncated&) {
            if (stop == end) throw;
        }
    }
}

struct Metadata {
    std::map<std::string, std::string> texts;
    std::map<std::string, std::array<std::int32_t, 3>> vectors;
    std::map<std::string, std::int64_t> integers;
};

Metadata take_metadata(Cursor& cursor) {
    Metadata found;
    const auto count = cursor.take<std::uint32_t>();
    for (std::uint32_t i = 0; i < count; ++i) {
        const std::string name = cursor.text();
        const std::string type = cursor.text();
        Cursor value(cursor.view(cursor.take<std::uint32_t>()));
        if (type == "string") {
            const auto text = value.view(value.remaining());
            found.texts[name].assign(text.data(), text.size());
        } else if (type == "vec3i") {
            found.vectors[name] = value.take<std::array<std::int32_t, 3>>();
        } else if (type == "int64") {
            found.integers[name] = value.take<std::int64_t>();
        }
    }
    return found;
}

template <class Map>
auto lookup(const Map& map, const std::string& key) -> std::optional<typename Map::mapped_type> {
    const auto found = map.find(key);
    if (found == map.end()) return std::nullopt;
    return found->second;
}

VdbTransform take_transform(Cursor& cursor) {
    using Vector = std::array<double, 3>;
    VdbTransform transform;
    transform.kind = cursor.text();
    const std::string_view kind = transform.kind;
    if (kind == "AffineMap" || kind == "UnitaryMap") {
        const auto matrix = cursor.take<std::array<std::array<double, 4>, 4>>();
        for (std::size_t row = 0; row < 3; ++row) {
            std::copy_n(matrix[row].begin(), 3, transform.linear[row].begin());
        }
        std::copy_n(matrix[3].begin(), 3, transform.translation.begin());
        return transform;
    }
    const bool scales = kind.find("Scale") != kind.npos;
    if (kind == "TranslationMap" || kind == "ScaleTranslateMap" ||
        kind == "UniformScaleTranslateMap") {
        transform.translation = cursor.take<Vector>();
    } else if (kind != "ScaleMap" && kind != "UniformScaleMap") {
        transform.is_linear = false;
        return transform;
    }
    const Vector scale = scales ? cursor.take<Vector>() : Vector{1, 1, 1};
    if (scales) cursor.skip(4 * sizeof(Vector));  // voxel size and inverses, which follow from it
    for (std::size_t axis = 0; axis < 3; ++axis) transform.linear[axis][axis] = scale[axis];
    return transform;
}

// "Tree_float_5_4_3_HalfFloat": type of values and how the tree branches.
void set_type(VdbGridInfo& grid, std::string tree) {
    constexpr std::string_view kHalf = "_HalfFloat", kPrefix = "Tree_", kBranching = "_5_4_3";
    if (tree.ends_with(kHalf)) {
        grid.is_half = true;
        tree.resize(tree.size() - kHalf.size());
    }
    if (tree.starts_with(kPrefix) && tree.ends_with(kBranching) &&
        tree.size() > kPrefix.size() + kBranching.size()) {
        tree = tree.substr(kPrefix.size(), tree.size() - kPrefix.size() - kBranching.size());
    }
    grid.value_type = tree;
}

// Names that are used twice are stored as "name", a separator, a number.
std::string readable_name(const std::string& unique) {
    constexpr char kSeparator = 30;
    const auto at = unique.find(kSeparator);
    if (at == unique.npos) return unique;
    return unique.substr(0, at) + "[" + unique.substr(at + 1) + "]";
}

VdbGridInfo take_descriptor(Cursor& cursor, std::uint64_t& next) {
    VdbGridInfo grid;
    grid.name = readable_name(cursor.text());
    set_type(grid, cursor.text());
    grid.instance_of = readable_name(cursor.text());
    grid.begin = cursor.take<std::uint64_t>();
    cursor.skip(sizeof(std::uint64_t));  // where the values of leaves begin
    grid.end = next = cursor.take<std::uint64_t>();
    return grid;
}

void take_head(Cursor& cursor, VdbGridInfo& grid) {
    grid.compression = cursor.take<std::uint32_t>();
    Metadata metadata = take_metadata(cursor);
    grid.transform = take_transform(cursor);
    grid.tree_offset = cursor.position();
    grid.grid_class = lookup(metadata.texts, "class").value_or("");
    grid.active_min_xyz = lookup(metadata.vectors, "file_bbox_min");
    grid.active_max_xyz = lookup(metadata.vectors, "file_bbox_max");
    grid.active_voxels = lookup(metadata.integers, "file_voxel_count");
    grid.texts = std::move(metadata.texts);
}

void require_readable(VdbVersion version, bool has_offsets) {
    if (version.file < kOldestVersion || version.file > kNewestVersion) {
        throw Unsupported("it has version " + std::to_string(version.file) +
                          " of the format; those read are " + std::to_string(kOldestVersion) +
                          " to " + std::to_string(kNewestVersion));
    }
    if (!has_offsets) throw Unsupported("it was written as a stream, without the places of grids");
}

}  // namespace

FileRange read_range(const std::string& path, std::uint64_t begin, std::uint64_t end) {
    return OpenFile(path).read(begin, end);
}

VdbFile list_grids(const std::string& path) {
    const OpenFile file(path);
    VdbFile listed;
    std::int32_t count = 0;
    std::uint64_t next = parse_at(file, 0, file.nbytes(), [&](Cursor& cursor) {
        require_sound(cursor.take<std::uint64_t>() == kMagic, "it does not begin as OpenVDB does");
        listed.version = cursor.take<VdbVersion>();
        require_readable(listed.version, cursor.take<char>() != 0);
        cursor.skip(kUuidNbytes);
        take_metadata(cursor);
        count = cursor.take<std::int32_t>();
        return std::uint64_t{cursor.position()};
    });
    require_sound(count >= 0 && count <= kMostGrids, "its number of grids makes no sense");
    for (std::int32_t i = 0; i < count; ++i) {
        VdbGridInfo grid = parse_at(file, next, file.nbytes(),
                                    [&](Cursor& cursor) { return take_descriptor(cursor, next); });
        if (grid.end > file.nbytes()) {
            throw Truncated("grid " + grid.name + " ends at byte " + std::to_string(grid.end) +
                            ", the file at " + std::to_string(file.nbytes()));
        }
        parse_at(file, grid.begin, grid.end, [&](Cursor& cursor) {
            take_head(cursor, grid);
            return 0;
        });
        listed.grids.push_back(std::move(grid));
    }
    return listed;
}

}  // namespace octobrick::store
