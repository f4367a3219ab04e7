#include "vdb_writer.h"

#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Prune.h>
#include <openvdb/tree/ValueAccessor.h>

#include <algorithm>

#include "faults.h"

namespace octobrick::store {

namespace {

using openvdb::Coord;

constexpr std::int32_t kSide = 8;  // of a leaf

template <class Grid>
class TreeWriter final : public VdbWriter {
  public:
    using Value = typename Grid::ValueType;

    explicit TreeWriter(double background)
        : grid_(Grid::create(static_cast<Value>(background))), tree_(grid_->tree()) {}

    void add(const IndexBox& box, const void* samples,
             const std::optional<ActiveRange>& active) override {
        const auto* values = static_cast<const Value*>(samples);
        const auto first = [&](int axis) { return box.start_xyz[axis] & ~(kSide - 1); };
        const auto stop = [&](int axis) { return box.start_xyz[axis] + box.shape_xyz[axis]; };
        for (std::int32_t z = first(2); z < stop(2); z += kSide) {
            for (std::int32_t y = first(1); y < stop(1); y += kSide) {
                for (std::int32_t x = first(0); x < stop(0); x += kSide) {
                    add_leaf(box, {x, y, z}, values, active);
                }
            }
        }
    }

    std::uint64_t active_voxels() const override { return grid_->tree().root().onVoxelCount(); }

    void save(const std::string& path, const VdbSaving& saving) override {
        openvdb::tools::prune(grid_->tree());
        grid_->setName(saving.name);
        grid_->setGridClass(openvdb::GridBase::stringToGridClass(saving.grid_class));
        grid_->setSaveFloatAsHalf(saving.half);
        const auto& [sx, sy, sz] = saving.spacing_xyz;
        const auto& [ox, oy, oz] = saving.origin_xyz;
        const auto transform = openvdb::math::Transform::createLinearTransform(1.0);
        transform->preScale(openvdb::Vec3d(sx, sy, sz));
        transform->postTranslate(openvdb::Vec3d(ox, oy, oz));
        grid_->setTransform(transform);
        openvdb::io::File file(path);
        file.write(openvdb::GridCPtrVec{grid_});
        file.close();
    }

  private:
    void add_leaf(const IndexBox& box, const Coord& origin, const Value* values,
                  const std::optional<ActiveRange>& active) {
        const auto& [start, shape] = box;
        typename Grid::TreeType::LeafNodeType* leaf = nullptr;  // made for the first active voxel
        const auto from = [&](int axis) { return std::max(origin[axis], start[axis]); };
        const auto to = [&](int axis) {
            return std::min(origin[axis] + kSide, start[axis] + shape[axis]);
        };
        for (std::int32_t z = from(2); z < to(2); ++z) {
            for (std::int32_t y = from(1); y < to(1); ++y) {
                const Value* row = values + row_offset(box, y, z);
                for (std::int32_t x = from(0); x < to(0); ++x) {
                    const Value value = row[x - start[0]];
                    if (active && !(value >= active->low && value <= active->high)) continue;
                    if (!leaf) leaf = tree_.touchLeaf(origin);
                    leaf->setValueOn(leaf->coordToOffset({x, y, z}), value);
                }
            }
        }
    }

    static std::size_t row_offset(const IndexBox& box, std::int32_t y, std::int32_t z) {
        const auto dz = static_cast<std::size_t>(z - box.start_xyz[2]);
        const auto dy = static_cast<std::size_t>(y - box.start_xyz[1]);
        return (dz * static_cast<std::size_t>(box.shape_xyz[1]) + dy) *
               static_cast<std::size_t>(box.shape_xyz[0]);
    }

    typename Grid::Ptr grid_;
    typename Grid::Accessor tree_;
};

}  // namespace

std::unique_ptr<VdbWriter> make_writer(const std::string& sample_type, double background) {
    openvdb::initialize();  // sets up compression; again is nothing
    if (sample_type == "float32") {
        return std::make_unique<TreeWriter<openvdb::FloatGrid>>(background);
    }
    if (sample_type == "float64") {
        return std::make_unique<TreeWriter<openvdb::DoubleGrid>>(background);
    }
    if (sample_type == "int32") {
        return std::make_unique<TreeWriter<openvdb::Int32Grid>>(background);
    }
    if (sample_type == "int64") {
        return std::make_unique<TreeWriter<openvdb::Int64Grid>>(background);
    }
    if (sample_type == "bool") return std::make_unique<TreeWriter<openvdb::BoolGrid>>(background);
    throw Unsupported("grids of " + sample_type + " are not written");
}

}  // namespace octobrick::store
