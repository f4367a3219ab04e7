// The decoder's own code, run on numbers that count what is done with them.

#include "zerobit_synthesis.h"

namespace octobrick::codec {
namespace detail {
namespace {

struct Counted {
    using Scalar = float;  // as for float32, every node is wholly transformed
    static inline thread_local ZerobitOperations done;

    friend Counted operator+(Counted, Counted) { return ++done.additions, Counted{}; }
    friend Counted operator-(Counted, Counted) { return ++done.additions, Counted{}; }
};

// A unit block of full cells: of the first, no detail is null. (The others share its bytes.)
struct FullCell {
    static constexpr std::size_t kStreams = 9 + kCellInfoNbytes * kCells;

    FullCell() {
        bytes[0] = kCells;
        std::memset(bytes + 1, 0xff, 8);
        store(bytes + 9 + 1, std::uint16_t{10});
        store(bytes + 9 + 3, std::uint16_t{0x8000});
        std::memset(bytes + kStreams, 0x7f, 10);
        bytes[kStreams] = bytes[kStreams + 1] = 0xff;
    }

    CellView view() const { return CellView(find_cell(bytes, 0), streams_of(bytes)); }

    std::uint8_t bytes[kStreams + 10 + 63 + kTailNbytes] = {};
};

}  // namespace

template <>
struct Codewords<Counted> {
    Counted operator[](std::uint8_t) const { return ++Counted::done.decodings, Counted{}; }
};

namespace {

template <class F>
ZerobitOperations count(const F& f) {
    const FullCell cell;
    const Synthesis<Counted> synthesis;
    Counted::done = {};
    f(synthesis, cell.view());
    return Counted::done;
}

constexpr auto kSame = [](Counted value) { return value; };
constexpr auto kIgnore = [](unsigned, unsigned, unsigned, Counted) {};

}  // namespace
}  // namespace detail

using namespace detail;

ZerobitOperations zerobit_voxel_operations(unsigned z, unsigned y, unsigned x) {
    return count([=](const auto& s, const CellView& cell) { s.voxel(cell, z, y, x); });
}

ZerobitOperations zerobit_plane_operations(unsigned axis, unsigned offset) {
    return count([=](const auto& s, const CellView& cell) {
        Part nodes[3], halves[3];
        nodes[axis] = Part::one(offset / 2);
        halves[axis] = Part::one(offset % 2);
        s.each_voxel(cell, nodes, halves, kSame, kIgnore);
    });
}

ZerobitOperations zerobit_cell_operations() {
    return count([](const auto& s, const CellView& cell) {
        const Part all[3];
        s.each_voxel(cell, all, all, kSame, kIgnore);
    });
}

}  // namespace octobrick::codec
