#include "vdb_grid.h"

#include <openvdb/openvdb.h>
#include <openvdb/tree/ValueAccessor.h>

#include <algorithm>
#include <istream>
#include <mutex>
#include <streambuf>
#include <utility>

#include "faults.h"
#include "vdb_check.h"

namespace octobrick::store {

namespace {

using openvdb::Coord;
using openvdb::CoordBBox;

// Bytes in memory as a stream: what OpenVDB reads from. It never seeks unless it may delay reading.
class MemoryBuffer : public std::streambuf {
  public:
    explicit MemoryBuffer(std::span<const char> bytes) {
        char* begin = const_cast<char*>(bytes.data());  // never written: there is no put area
        setg(begin, begin, begin + bytes.size());
    }
};

CoordBBox to_bbox(const IndexBox& box) {
    const auto& [start, shape] = box;
    return {Coord(start[0], start[1], start[2]),
            Coord(start[0] + shape[0] - 1, start[1] + shape[1] - 1, start[2] + shape[2] - 1)};
}

// Calls visit with each cell of a grid of cubes that meets the box, until it says false.
template <int kSide, class Visit>
bool for_each_cell(const CoordBBox& box, Visit visit) {
    constexpr std::int32_t kMask = ~(kSide - 1);
    const Coord first = box.min() & kMask;
    for (std::int32_t x = first.x(); x <= box.max().x(); x += kSide) {
        for (std::int32_t y = first.y(); y <= box.max().y(); y += kSide) {
            for (std::int32_t z = first.z(); z <= box.max().z(); z += kSide) {
                CoordBBox cell = CoordBBox::createCube(Coord(x, y, z), kSide);
                cell.intersect(box);
                if (!visit(cell)) return false;
            }
        }
    }
    return true;
}

template <class T>
struct Samples {
    using Type = T;
    static constexpr std::size_t kCount = 1;
    static T get(const T& value, std::size_t) { return value; }
};

template <class T>
struct Samples<openvdb::math::Vec3<T>> {
    using Type = T;
    static constexpr std::size_t kCount = 3;
    static T get(const openvdb::math::Vec3<T>& value, std::size_t component) {
        return value[static_cast<int>(component)];
    }
};

template <class Tree>
class LoadedGrid final : public VdbGrid {
  public:
    using Value = typename Tree::ValueType;
    using Sample = typename Samples<Value>::Type;
    using Leaf = typename Tree::LeafNodeType;
    using Lower = typename Tree::RootNodeType::ChildNodeType::ChildNodeType;

    explicit LoadedGrid(std::unique_ptr<Tree> tree) : tree_(std::move(tree)) {}

    std::optional<IndexBox> active_box() const override {
        CoordBBox box;
        if (!tree_->evalActiveVoxelBoundingBox(box)) return std::nullopt;
        const Coord shape = box.dim();
        return IndexBox{{box.min().x(), box.min().y(), box.min().z()},
                        {shape.x(), shape.y(), shape.z()}};
    }
    std::uint64_t active_voxels() const override { return tree_->root().onVoxelCount(); }
    std::uint64_t leaves() const override { return tree_->root().leafCount(); }
    std::uint64_t memory_nbytes() const override { return tree_->root().memUsage(); }
    std::size_t components() const override { return Samples<Value>::kCount; }
    double background(std::size_t component) const override {
        return static_cast<double>(Samples<Value>::get(tree_->background(), component));
    }

    void fill(const IndexBox& index_box, std::size_t component, void* out) const override {
        const CoordBBox box = to_bbox(index_box);
        const auto nx = static_cast<std::size_t>(index_box.shape_xyz[0]);
        const auto ny = static_cast<std::size_t>(index_box.shape_xyz[1]);
        const auto row_of = [&, samples = static_cast<Sample*>(out)](
                                const CoordBBox& part, std::int32_t y, std::int32_t z) {
            const auto dz = static_cast<std::size_t>(z - box.min().z());
            const auto dy = static_cast<std::size_t>(y - box.min().y());
            const auto dx = static_cast<std::size_t>(part.min().x() - box.min().x());
            return samples + (dz * ny + dy) * nx + dx;
        };
        walk(
            box,
            [&](const CoordBBox& part, const Leaf& leaf) {
                const auto length = part.dim().x();
                for (std::int32_t z = part.min().z(); z <= part.max().z(); ++z) {
                    for (std::int32_t y = part.min().y(); y <= part.max().y(); ++y) {
                        Sample* row = row_of(part, y, z);
                        const auto at = Leaf::coordToOffset(Coord(part.min().x(), y, z));
                        copy_along_x(leaf, at, length, component, row);
                    }
                }
                return true;
            },
            [&](const CoordBBox& part, const Value& value) {
                const Sample sample = Samples<Value>::get(value, component);
                for (std::int32_t z = part.min().z(); z <= part.max().z(); ++z) {
                    for (std::int32_t y = part.min().y(); y <= part.max().y(); ++y) {
                        std::fill_n(row_of(part, y, z), part.dim().x(), sample);
                    }
                }
                return true;
            });
    }

    std::optional<double> constant(const IndexBox& box, std::size_t component) const override {
        std::optional<Sample> same;
        const bool is_constant = walk(
            to_bbox(box), [](const CoordBBox&, const Leaf&) { return false; },
            [&](const CoordBBox&, const Value& value) {
                const Sample sample = Samples<Value>::get(value, component);
                if (!same) same = sample;
                return *same == sample;
            });
        if (!is_constant || !same) return std::nullopt;
        return static_cast<double>(*same);
    }

  private:
    // In a leaf z is fastest: a step along x is a plane of 8×8.
    static void copy_along_x(const Leaf& leaf, openvdb::Index at, std::int32_t length,
                             std::size_t component, Sample* row) {
        constexpr openvdb::Index kStep = Leaf::DIM * Leaf::DIM;
        if constexpr (std::is_same_v<Value, bool>) {
            for (std::int32_t i = 0; i < length; ++i, at += kStep) row[i] = leaf.getValue(at);
        } else {
            const Value* values = leaf.buffer().data();
            for (std::int32_t i = 0; i < length; ++i, at += kStep) {
                row[i] = Samples<Value>::get(values[at], component);
            }
        }
    }

    // Visits the parts of a box: those in a leaf with it, others with their one value. Space
    // without nodes goes by cubes of the lower inner nodes, 128³ voxels. False if a visit said so.
    template <class VisitLeaf, class VisitConstant>
    bool walk(const CoordBBox& box, VisitLeaf visit_leaf, VisitConstant visit_constant) const {
        // Not registered with the tree: it does not change while it is read.
        openvdb::tree::ValueAccessor<const Tree, false> tree(*tree_);
        return for_each_cell<Lower::DIM>(box, [&](const CoordBBox& cube) {
            if (!tree.template probeConstNode<Lower>(cube.min())) {
                return visit_constant(cube, tree.getValue(cube.min()));
            }
            return for_each_cell<Leaf::DIM>(cube, [&](const CoordBBox& part) {
                const Leaf* leaf = tree.probeConstLeaf(part.min());
                return leaf ? visit_leaf(part, *leaf)
                            : visit_constant(part, tree.getValue(part.min()));
            });
        });
    }

    std::unique_ptr<Tree> tree_;
};

template <class Tree>
std::unique_ptr<VdbGrid> load(std::span<const char> bytes, const VdbFile& file,
                              const VdbGridInfo& grid) {
    using Value = typename Tree::ValueType;
    using Half = openvdb::io::RealToHalf<Value>;
    const bool is_half = grid.is_half && Half::isReal;
    check_tree(bytes, {sizeof(Value), is_half ? sizeof(typename Half::HalfT) : sizeof(Value),
                       std::is_same_v<Value, bool>, grid.compression});
    MemoryBuffer buffer(bytes);
    std::istream stream(&buffer);
    stream.exceptions(std::ios::failbit | std::ios::badbit | std::ios::eofbit);
    const auto& [version, major, minor] = file.version;
    openvdb::io::setVersion(stream, {major, minor}, version);
    openvdb::io::setDataCompression(stream, grid.compression);
    openvdb::io::setGridClass(stream, openvdb::GridBase::stringToGridClass(grid.grid_class));
    auto tree = std::make_unique<Tree>();
    tree->readTopology(stream, is_half);
    tree->readBuffers(stream, is_half);
    // What the stream held of the tree must not outlive this call.
    openvdb::io::setGridBackgroundValuePtr(stream, nullptr);
    return std::make_unique<LoadedGrid<Tree>>(std::move(tree));
}

struct Type {
    const char* value_type;
    const char* sample_type;
    std::unique_ptr<VdbGrid> (*load)(std::span<const char>, const VdbFile&, const VdbGridInfo&);
};

constexpr Type kTypes[] = {
    {"float", "float32", load<openvdb::FloatTree>},
    {"double", "float64", load<openvdb::DoubleTree>},
    {"int32", "int32", load<openvdb::Int32Tree>},
    {"int64", "int64", load<openvdb::Int64Tree>},
    {"bool", "bool", load<openvdb::BoolTree>},
    {"vec3s", "float32", load<openvdb::Vec3STree>},
    {"vec3d", "float64", load<openvdb::Vec3DTree>},
};

const Type* find_type(const std::string& value_type) {
    const auto* found = std::find_if(std::begin(kTypes), std::end(kTypes), [&](const Type& type) {
        return type.value_type == value_type;
    });
    return found == std::end(kTypes) ? nullptr : found;
}

}  // namespace

const char* sample_type(const std::string& value_type) {
    const Type* type = find_type(value_type);
    return type ? type->sample_type : nullptr;
}

std::unique_ptr<VdbGrid> load_grid(const std::string& path, const VdbFile& file,
                                   std::size_t index) {
    const VdbGridInfo* grid = &file.grids.at(index);
    if (!grid->instance_of.empty()) {  // its tree is stored with another grid
        const auto parent =
            std::find_if(file.grids.begin(), file.grids.end(),
                         [&](const VdbGridInfo& other) { return other.name == grid->instance_of; });
        require_sound(parent != file.grids.end() && parent->instance_of.empty(),
                      "a grid shares the voxels of one that has none");
        grid = &*parent;
    }
    const Type* type = find_type(grid->value_type);
    if (!type) throw Unsupported("the values of grid " + grid->name + " are " + grid->value_type);
    static std::once_flag once;
    std::call_once(once, openvdb::initialize);
    const FileRange range = read_range(path, grid->begin + grid->tree_offset, grid->end);
    return type->load(range.bytes(), file, *grid);
}

}  // namespace octobrick::store
