// Zerobit: wavelet compression of scalar and RGB volumes, with any voxel found in constant time.
//
// Bajaj, Ihm, Park, "3D RGB Image Compression for Interactive Applications", 2001: cells of 4^3
// voxels are Haar-transformed, few detail coefficients are kept, and these become indices to a
// codebook. docs/spec/zerobit.md gives the bytes.
//
// What every function here promises:
//   - It throws nothing but std::bad_alloc.
//   - It is safe to call from any threads at once, as long as nobody writes what it reads. It
//     keeps no state, and no thread outlives the call.
//   - Its result does not depend on the number of threads or on the machine.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "octobrick/codec/view.h"

namespace octobrick::codec {

enum class ZerobitStatus : std::uint8_t {
    ok,
    unsupported_type,  // neither one channel, nor three of u8 or u16
    empty_shape,       // a volume axis of 0
    too_large,         // 2^32 voxels or more along an axis, or bytes in the unit blocks
    not_finite,        // NaN or an infinity; `at` is one such voxel
    wrong_codebook,    // the codebook is not one, or not of this volume or code
    bad_header,        // not the header that an encoder writes
    wrong_nbytes,      // the code has `second` bytes where its header says `first`
    bad_block,         // not what an encoder writes; `at` is the unit block
};

// How a call ended.
struct ZerobitOutcome {
    ZerobitStatus status = ZerobitStatus::ok;
    Zyx at;
    double first = 0, second = 0;
};

// A sample per channel; of one channel, the first.
using ZerobitColour = std::array<double, 3>;

// Samples in native byte order, C order (z, y, x, channel), without gaps. Owns nothing.
struct ZerobitVolume {
    const std::byte* origin = nullptr;
    SampleType type = SampleType::u8;
    unsigned channels = 1;
    Zyx shape;
};

struct ZerobitSettings {
    double ratio = 0.05;          // details to keep, of all coefficients of the wanted cells
    bool global = true;           // one threshold for all, not one per unit block
    bool orthonormal = true;      // rank by weight in the squared error, not by the bare norm
    bool count_averages = false;  // averages compete with details, and may become background
    std::optional<ZerobitColour> background;  // unset: the commonest value of constant cells
};

// The bytes of a shared codebook, from any number of volumes of one type.
class ZerobitTrainer {
  public:
    ZerobitTrainer(SampleType type, unsigned channels, const ZerobitSettings& settings);
    ~ZerobitTrainer();
    // Adds what `zerobit_encode` would keep. Fails with unsupported_type (also for a volume of
    // another type or channels than the trainer's), empty_shape, too_large or not_finite.
    ZerobitOutcome add(const ZerobitVolume& volume, unsigned threads = 0);
    std::vector<std::byte> codebook() const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

// Writes the code of a volume. `wanted` has a byte per cell (z, y, x; ceil(n/4) per axis), 0 for a
// cell that is not wanted and becomes null; empty means that all are. `codebook` is empty, or the
// bytes of a shared codebook. Fails as ZerobitTrainer::add does, or with wrong_codebook.
ZerobitOutcome zerobit_encode(const ZerobitVolume& volume, const ZerobitSettings& settings,
                              std::span<const std::uint8_t> wanted,
                              std::span<const std::byte> codebook, std::vector<std::byte>& code,
                              unsigned threads = 0);

// What a header says, and where the parts of the code lie.
struct ZerobitHeader {
    SampleType type = SampleType::u8;
    unsigned channels = 1;
    bool shared = false;
    Zyx shape, grid;  // voxels; unit blocks
    std::size_t average_count = 0, detail_count = 0;
    std::uint64_t digest = 0;
    ZerobitColour background{};
    double least = 0, greatest = 0;
    float threshold_step = 0;
    std::size_t blocks = 0, codebook_nbytes = 0, blocks_nbytes = 0;
    std::size_t thresholds_at = 0, pointers_at = 0, blocks_at = 0, nbytes = 0;
};

// Counts over the unit blocks of a code.
struct ZerobitStats {
    std::size_t cells = 0;               // that are not null
    std::size_t details = 0;             // that are not null
    std::size_t null_nodes[2] = {0, 0};  // of cells that are not null, at level 0 and level 1
};

// Reads a code without decoding all of it. It keeps a view of the code, which must outlive it.
//
// Only open(), check() and check_block() are safe for hostile bytes. What else reads a unit block
// must be preceded by one of the latter two, with `ok`, for that unit block. Positions must lie
// within the volume, or its grid of ceil(n/4) cells.
class ZerobitReader {
  public:
    // Checks the header; `codebook` as in zerobit_encode. Allocates about 30 KB.
    // Fails with bad_header, wrong_nbytes or wrong_codebook.
    static ZerobitOutcome open(std::span<const std::byte> code, std::span<const std::byte> codebook,
                               std::unique_ptr<ZerobitReader>& reader);
    virtual ~ZerobitReader() = default;

    const ZerobitHeader& header() const { return header_; }
    // The norm that no detail coefficient dropped in a unit block exceeded, as one of level 1.
    float threshold(std::size_t block) const;

    // Fail with bad_block.
    ZerobitOutcome check(unsigned threads = 0) const;
    ZerobitOutcome check_block(Zyx block) const;

    // Voxel mode: out has a sample per position and channel.
    virtual void voxels(std::span<const Zyx> at, std::byte* out) const = 0;
    // Plane mode: the 4^2 voxels of a cell with coordinate `offset` (0 to 3) on `axis` (0 is z);
    // the axes that remain keep their order.
    virtual void plane(Zyx cell, unsigned axis, unsigned offset, std::byte* out) const = 0;
    // Cell mode: the 4^3 voxels of each cell, those outside of the volume too. Many at once are
    // faster than one by one, as they are in voxel mode.
    virtual void cells(std::span<const Zyx> at, std::byte* out) const = 0;
    void cell(Zyx at, std::byte* out) const { cells({&at, 1}, out); }
    // The volume at level 0, 1 or 2, of ceil(n / 2^level) voxels per axis.
    virtual void level(unsigned level, std::byte* out, unsigned threads = 0) const = 0;

    ZerobitStats stats() const;

  protected:
    ZerobitReader(std::span<const std::byte> code, const ZerobitHeader& header);
    const std::uint8_t* block(std::size_t index) const;

    const std::uint8_t* code_;
    ZerobitHeader header_;

  private:
    ZerobitOutcome check_block(std::size_t index) const;
};

// How many additions the inverse transform makes and how many coefficients it decodes, counted in
// the code that decodes, for a cell without null nodes.
struct ZerobitOperations {
    std::size_t additions = 0, decodings = 0;
};
ZerobitOperations zerobit_voxel_operations(unsigned z, unsigned y, unsigned x);
ZerobitOperations zerobit_plane_operations(unsigned axis, unsigned offset);
ZerobitOperations zerobit_cell_operations();

}  // namespace octobrick::codec
