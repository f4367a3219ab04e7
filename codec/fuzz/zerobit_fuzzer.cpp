// Hostile codes: whatever the bytes, a reader ends with a status or decodes, touches nothing that
// is not its own, and says the same in all of its modes.
//
// What begins like a code, with an O, is taken for one. Anything else makes a volume, whose code is
// then changed at a few places: so mutations get behind the header, and what encodes must decode.

#include <cstring>
#include <vector>

#include "fuzz.h"
#include "octobrick/codec/zerobit.h"

namespace {

using namespace octobrick::codec;

using Block = octobrick::fuzz::Exact<std::byte>;

constexpr std::size_t kMostVoxels = std::size_t{1} << 20;  // what one input may take the time for

// Reads everything in every mode. Returns whether the code was accepted.
bool read_all(std::span<const std::byte> given, std::span<const std::byte> codebook) {
    const Block code(given);
    std::unique_ptr<ZerobitReader> reader;
    if (ZerobitReader::open(code.span(), codebook, reader).status != ZerobitStatus::ok) {
        return false;
    }
    const ZerobitHeader& h = reader->header();
    // What is allocated for a code is bounded by its size.
    REQUIRE(h.blocks <= given.size() / 6);
    const Zyx s = h.shape;
    if (s.z * s.y * s.x > kMostVoxels) return false;
    const std::size_t unit = h.channels * sample_nbytes(h.type);
    const bool sound = reader->check().status == ZerobitStatus::ok;

    Block volume(s.z * s.y * s.x * unit), cell(64 * unit), plane(16 * unit), voxel(unit);
    if (sound) {
        reader->level(0, volume.data());
        for (unsigned level = 1; level <= 2; ++level) {
            const std::size_t round = (std::size_t{1} << level) - 1;
            Block coarse(((s.z + round) >> level) * ((s.y + round) >> level) *
                         ((s.x + round) >> level) * unit);
            reader->level(level, coarse.data());
        }
        const ZerobitStats stats = reader->stats();
        REQUIRE(stats.details <= 63 * stats.cells);
    }
    // One cell of each unit block, if that block is sound: first and last voxel in three modes.
    for (std::size_t i = 0; i < h.blocks; ++i) {
        const Zyx block = {i / (h.grid.y * h.grid.x), i / h.grid.x % h.grid.y, i % h.grid.x};
        const bool ok = reader->check_block(block).status == ZerobitStatus::ok;
        REQUIRE(ok || !sound);
        if (!ok) continue;
        (void)reader->threshold(i);
        for (const Zyx at :
             {Zyx{16 * block.z, 16 * block.y, 16 * block.x},
              Zyx{std::min(16 * block.z + 15, s.z - 1), std::min(16 * block.y + 15, s.y - 1),
                  std::min(16 * block.x + 15, s.x - 1)}}) {
            reader->voxels({&at, 1}, voxel.data());
            reader->cell({at.z / 4, at.y / 4, at.x / 4}, cell.data());
            const std::size_t in_cell = 16 * (at.z % 4) + 4 * (at.y % 4) + at.x % 4;
            REQUIRE(std::memcmp(&voxel[0], &cell[in_cell * unit], unit) == 0);
            const std::size_t local[3] = {at.z % 4, at.y % 4, at.x % 4};
            for (unsigned axis = 0; axis < 3; ++axis) {
                reader->plane({at.z / 4, at.y / 4, at.x / 4}, axis,
                              static_cast<unsigned>(local[axis]), plane.data());
                const std::size_t in_plane =
                    4 * local[axis == 0 ? 1 : 0] + local[axis == 2 ? 1 : 2];
                REQUIRE(std::memcmp(&voxel[0], &plane[in_plane * unit], unit) == 0);
            }
            if (sound) {
                const std::size_t in_volume = (at.z * s.y + at.y) * s.x + at.x;
                REQUIRE(std::memcmp(&voxel[0], &volume[in_volume * unit], unit) == 0);
            }
        }
    }
    return sound;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    constexpr std::size_t kParameters = 8;
    if (size < kParameters) return 0;
    const std::span<const std::byte> bytes(reinterpret_cast<const std::byte*>(data), size);
    if (data[0] == 'O') {
        read_all(bytes, {});
        return 0;
    }

    static constexpr struct {
        SampleType type;
        unsigned channels;
    } kKinds[] = {{SampleType::u8, 1},  {SampleType::i8, 1},  {SampleType::u16, 1},
                  {SampleType::i16, 1}, {SampleType::f32, 1}, {SampleType::u8, 3},
                  {SampleType::u16, 3}};
    const auto kind = kKinds[data[1] % 7];
    const Zyx shape = {1 + data[2] % 20u, 1 + data[3] % 20u, 1 + data[4] % 36u};
    ZerobitSettings settings;
    settings.ratio = data[5] / 255.0;
    settings.global = (data[6] & 1) != 0;
    settings.orthonormal = (data[6] & 2) != 0;
    settings.count_averages = (data[6] & 4) != 0;
    if ((data[6] & 8) != 0) settings.background = ZerobitColour{1, 2, 3};
    const std::size_t changes = data[7] % 8u;

    const std::span<const std::byte> rest = bytes.subspan(kParameters);
    constexpr std::size_t kChange = 3;
    if (rest.size() < kChange * changes + 4) return 0;
    const std::span<const std::byte> samples = rest.subspan(kChange * changes);
    Block voxels(shape.z * shape.y * shape.x * kind.channels * sample_nbytes(kind.type));
    for (std::size_t i = 0; i < voxels.span().size(); ++i) {
        voxels[i] = samples[(i * i / 64 + i) % samples.size()];
    }
    const ZerobitVolume volume{voxels.data(), kind.type, kind.channels, shape};
    std::vector<std::byte> codebook;
    if ((data[6] & 16) != 0) {
        ZerobitTrainer trainer(kind.type, kind.channels, settings);
        if (trainer.add(volume).status != ZerobitStatus::ok) return 0;
        codebook = trainer.codebook();
    }
    std::vector<std::byte> code;
    if (zerobit_encode(volume, settings, {}, codebook, code).status != ZerobitStatus::ok) {
        REQUIRE(kind.type == SampleType::f32);  // not finite
        return 0;
    }
    REQUIRE(read_all(code, codebook));
    for (std::size_t i = 0; i < changes; ++i) {
        const std::byte* change = rest.data() + kChange * i;
        const auto at =
            static_cast<std::size_t>(change[0]) << 8 | static_cast<std::size_t>(change[1]);
        code[at % code.size()] ^= change[2];
    }
    read_all(code, codebook);
    return 0;
}
