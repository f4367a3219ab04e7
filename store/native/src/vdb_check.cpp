#include "vdb_check.h"

#include <array>
#include <bit>
#include <map>
#include <vector>

#include "cursor.h"
#include "faults.h"

namespace octobrick::store {

namespace {

// The stored flags of openvdb/io/Compression.h.
constexpr std::uint32_t kZip = 1, kActiveMask = 2, kBlosc = 4;

// A child of the root spans 4096³ voxels. Coordinates this far from the ends of 32 bits leave room
// for sums.
constexpr std::int32_t kRootChildSide = 4096;
constexpr std::int32_t kFarthest = 1 << 30;

constexpr std::size_t kBloscHeadNbytes = 16;

using Coord = std::array<std::int32_t, 3>;

// One bit for each of the values of a node.
class Mask {
  public:
    Mask(Cursor& cursor, std::size_t size) : bytes_(cursor.view(size / 8)) {}

    std::size_t count() const {
        std::size_t on = 0;
        for (const char byte : bytes_) on += std::popcount(static_cast<unsigned char>(byte));
        return on;
    }

    template <class Visit>
    void for_each_on(Visit visit) const {
        for (std::size_t i = 0; i < bytes_.size(); ++i) {
            for (unsigned bits = static_cast<unsigned char>(bytes_[i]); bits; bits &= bits - 1) {
                visit(8 * i + static_cast<std::size_t>(std::countr_zero(bits)));
            }
        }
    }

    std::size_t nbytes() const { return bytes_.size(); }

  private:
    std::span<const char> bytes_;
};

// Where a child lies whose number in its parent has z fastest.
Coord child_origin(const Coord& parent, std::size_t offset, unsigned log2_children,
                   unsigned log2_side) {
    const std::size_t last = (std::size_t{1} << log2_children) - 1;
    const auto along = [&](unsigned digit) {
        return static_cast<std::int32_t>(((offset >> (digit * log2_children)) & last) << log2_side);
    };
    return {parent[0] + along(2), parent[1] + along(1), parent[2] + along(0)};
}

class TreeCheck {
  public:
    TreeCheck(std::span<const char> tree, const VdbValues& values)
        : cursor_(tree), values_(values) {}

    std::uint64_t run() {
        require_sound(cursor_.take<std::int32_t>() == 1, "a tree has more than one buffer");
        cursor_.skip(values_.nbytes);  // background
        const auto ntiles = cursor_.take<std::uint32_t>();
        const auto nchildren = cursor_.take<std::uint32_t>();
        std::map<Coord, std::size_t> children;  // the order in which buffers are stored
        for (std::uint32_t i = 0; i < ntiles; ++i) {
            require_sound(children.emplace(take_root_coord(), kTile).second, "a tile comes twice");
            cursor_.skip(values_.nbytes + 1);
        }
        for (std::uint32_t i = 0; i < nchildren; ++i) {
            const Coord origin = take_root_coord();
            require_sound(children.emplace(origin, leaves_.size()).second, "a node comes twice");
            check_upper(origin);
        }
        check_buffers(children);
        return leaves_.size();
    }

  private:
    static constexpr std::size_t kTile = ~std::size_t{0};

    Coord take_root_coord() {
        const auto origin = cursor_.take<Coord>();
        for (const std::int32_t at : origin) {
            require_sound(at % kRootChildSide == 0 && at >= -kFarthest && at <= kFarthest,
                          "a node lies where none can be");
        }
        return origin;
    }

    void check_upper(const Coord& origin) {
        constexpr unsigned kLog2Children = 5, kLog2Side = 7;
        const Mask children(cursor_, kUpperSize), active(cursor_, kUpperSize);
        check_values(active, kUpperSize);
        children.for_each_on([&](std::size_t offset) {
            check_lower(child_origin(origin, offset, kLog2Children, kLog2Side));
        });
    }

    void check_lower(const Coord& origin) {
        constexpr unsigned kLog2Children = 4, kLog2Side = 3;
        const Mask children(cursor_, kLowerSize), active(cursor_, kLowerSize);
        check_values(active, kLowerSize);
        children.for_each_on([&](std::size_t offset) {
            const Mask leaf(cursor_, kLeafSize);
            leaves_.push_back(child_origin(origin, offset, kLog2Children, kLog2Side));
        });
    }

    // Leaves in the order of nodes in the table of the root, whatever order the file has.
    void check_buffers(const std::map<Coord, std::size_t>& children) {
        for (const auto& [origin, first] : children) {
            if (first == kTile) continue;
            std::size_t leaf = first;
            for (; leaf < leaves_.size() && is_inside(leaves_[leaf], origin); ++leaf) {
                check_leaf(leaves_[leaf]);
            }
        }
    }

    static bool is_inside(const Coord& leaf, const Coord& origin) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto within = std::int64_t{leaf[axis]} - origin[axis];
            if (within < 0 || within >= kRootChildSide) return false;
        }
        return true;
    }

    void check_leaf(const Coord& origin) {
        const Mask active(cursor_, kLeafSize);
        if (!values_.is_bool) {
            check_values(active, kLeafSize);
            return;
        }
        require_sound(cursor_.take<Coord>() == origin, "a leaf says that it lies elsewhere");
        const Mask values(cursor_, kLeafSize);
    }

    // The values of one node, as io::readCompressedValues reads them.
    void check_values(const Mask& active, std::size_t size) {
        enum { kOneInactive = 2, kMask = 3, kMaskAndOne = 4, kMaskAndTwo = 5, kAll = 6 };
        const int kept = cursor_.take<std::int8_t>();
        require_sound(kept >= 0 && kept <= kAll, "the values of a node are stored in no known way");
        if (kept == kOneInactive || kept == kMaskAndOne || kept == kMaskAndTwo) {
            cursor_.skip(values_.nbytes * (kept == kMaskAndTwo ? 2 : 1));
        }
        if (kept == kMask || kept == kMaskAndOne || kept == kMaskAndTwo) {
            cursor_.skip(active.nbytes());
        }
        const bool only_active = (values_.compression & kActiveMask) && kept != kAll;
        check_data((only_active ? active.count() : size) * values_.stored_nbytes);
    }

    void check_data(std::size_t nbytes) {
        if (nbytes == 0 && values_.stored_nbytes < values_.nbytes)
            return;  // halves: nothing at all
        if (!(values_.compression & (kZip | kBlosc))) {
            cursor_.skip(nbytes);
            return;
        }
        const auto stored = cursor_.take<std::int64_t>();
        if (stored <= 0) {
            require_sound(-stored == static_cast<std::int64_t>(nbytes),
                          "the values of a node have another size than the node");
            cursor_.skip(nbytes);
            return;
        }
        Cursor packed(cursor_.view(static_cast<std::uint64_t>(stored)));
        if (values_.compression & kBlosc) {
            require_sound(packed.remaining() >= kBloscHeadNbytes, "a blosc buffer has no header");
            packed.skip(4);
            const auto unpacked_nbytes = packed.take<std::uint32_t>();
            packed.skip(4);
            require_sound(
                unpacked_nbytes == nbytes && packed.take<std::uint32_t>() == std::uint64_t(stored),
                "a blosc buffer has another size than its node");
        }
    }

    static constexpr std::size_t kUpperSize = 32 * 32 * 32;
    static constexpr std::size_t kLowerSize = 16 * 16 * 16;
    static constexpr std::size_t kLeafSize = 8 * 8 * 8;

    Cursor cursor_;
    VdbValues values_;
    std::vector<Coord> leaves_;
};

}  // namespace

std::uint64_t check_tree(std::span<const char> tree, const VdbValues& values) {
    return TreeCheck(tree, values).run();
}

}  // namespace octobrick::store
