// How long it takes to get voxels out of a zerobit code, beside fetching them from an array, and
// beside the coding with 64 flags per cell that came before (zerobit_flags.h).
//
//   zerobit_access VOXELS CODE ROUNDS
//
// VOXELS are the raw samples of the volume that CODE (with its own codebook) is of. Every access
// is done in all ways in one process, alternating, on the same positions and into the same kind of
// buffer; medians over the rounds are written as JSON, in nanoseconds of one thread per voxel.
// Before that, the older coding must give the same voxels.

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "octobrick/codec/zerobit.h"
#include "zerobit_array.h"
#include "zerobit_flags.h"

namespace octobrick::bench {
namespace {

using namespace codec;
using Bytes = std::vector<std::byte>;

[[noreturn]] void fail(const char* what, const char* which) {
    std::fprintf(stderr, "%s: %s\n", which, what);
    std::exit(1);
}

Bytes read_file(const char* path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    if (!file) fail("cannot be read", path);
    Bytes bytes(static_cast<std::size_t>(file.tellg()));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return bytes;
}

// One of the ways to do an access.
struct Way {
    std::string name;
    std::function<void()> run;
    std::vector<double> ns = {};
};

struct Access {
    std::string name;
    std::size_t voxels;
    std::vector<Way> ways;
};

// Of the processor, not of the wall: others may run on it meanwhile.
double thread_ns() {
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) * 1e9 + static_cast<double>(now.tv_nsec);
}

double time_ns(const std::function<void()>& f, std::size_t voxels) {
    const double start = thread_ns();
    f();
    return (thread_ns() - start) / static_cast<double>(voxels);
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

void print(const std::vector<Access>& accesses, std::size_t flags_nbytes) {
    std::printf("{\n  \"flags_nbytes\": %zu,\n  \"accesses\": {", flags_nbytes);
    const char* separator = "";
    for (const Access& access : accesses) {
        std::printf("%s\n    \"%s\": {", separator, access.name.c_str());
        separator = "";
        for (const Way& way : access.ways) {
            std::printf("%s\"%s_ns\": %.4f", separator, way.name.c_str(), median(way.ns));
            separator = ", ";
        }
        std::printf("}");
        separator = ",";
    }
    std::printf("\n  }\n}\n");
}

// Everything that a volume is asked for, and what is asked.
template <std::size_t Unit>
class Measurement {
  public:
    Measurement(const Bytes& voxels, const Bytes& code, const ZerobitReader& reader)
        : reader_(reader),
          array_{voxels.data(), reader.header().shape},
          table_(recode_with_flags(code, reader.header(), Counting::table)),
          instruction_(recode_with_flags(code, reader.header(), Counting::instruction)),
          out_(std::max({kVoxels * Unit, voxels.size(), 64 * kCells * Unit})) {
        if (table_ == nullptr) fail("cannot be coded with flags", "code");
        std::mt19937 random(1);
        const Zyx shape = array_.shape;
        positions_ = random_in(shape, kVoxels, random);
        slices_ = cutting_planes(shape, kVoxels, random);
        cells_ = random_in({shape.z / 4, shape.y / 4, shape.x / 4}, kCells, random);
    }

    // Whether all three codings give the same voxels, wherever they will be asked.
    bool same_voxels() {
        const Bytes ours = output([&](std::byte* out) { points_and_cells(reader_, out); });
        const Bytes table = output([&](std::byte* out) { points_and_cells(*table_, out); });
        if (ours != table) return false;
        return instruction_ == nullptr ||
               ours == output([&](std::byte* out) { points_and_cells(*instruction_, out); });
    }

    std::size_t flags_nbytes() const { return table_->nbytes(); }

    std::vector<Access> run(unsigned rounds) {
        std::vector<Access> accesses = {points("voxel_random", positions_),
                                        points("voxel_cutting_planes", slices_),
                                        plane("plane_z", 0),
                                        plane("plane_y", 1),
                                        plane("plane_x", 2),
                                        cell(),
                                        cells(),
                                        volume()};
        for (unsigned round = 0; round < rounds; ++round) {
            for (Access& access : accesses) {
                for (Way& way : access.ways) way.ns.push_back(time_ns(way.run, access.voxels));
            }
        }
        return accesses;
    }

  private:
    static constexpr std::size_t kVoxels = 1000000, kCells = 20000;

    static std::vector<Zyx> random_in(Zyx extent, std::size_t count, std::mt19937& random) {
        const auto below = [&](std::size_t n) {
            return std::uniform_int_distribution<std::size_t>(0, n - 1)(random);
        };
        std::vector<Zyx> at(count);
        for (Zyx& p : at) p = {below(extent.z), below(extent.y), below(extent.x)};
        return at;
    }

    template <class F>
    static Bytes output(const F& write) {
        Bytes out((2 * kVoxels + 64 * kCells) * Unit);
        write(out.data());
        return out;
    }

    template <class Reader>
    void points_and_cells(const Reader& reader, std::byte* out) const {
        reader.voxels(positions_, out);
        reader.voxels(slices_, out + kVoxels * Unit);
        reader.cells(cells_, out + 2 * kVoxels * Unit);
    }

    template <class F>
    void each_cell(const F& f, std::byte* out) const {
        for (const Zyx& at : cells_) {
            f(at, out);
            out += 64 * Unit;
        }
    }

    // The ways with flags that this machine has, after the others. f(reader) is one access.
    template <class F>
    void add_flags(Access& access, const F& f) const {
        access.ways.push_back({"flags_table", [this, f] { f(*table_); }});
        if (instruction_ != nullptr) {
            access.ways.push_back({"flags_popcount", [this, f] { f(*instruction_); }});
        }
    }

    Access points(const char* name, const std::vector<Zyx>& at) {
        Access access{name,
                      at.size(),
                      {{"array", [this, &at] { array_.fetch(at, out_.data()); }},
                       {"code", [this, &at] { reader_.voxels(at, out_.data()); }}}};
        add_flags(access, [this, &at](const FlagsReader& r) { r.voxels(at, out_.data()); });
        return access;
    }

    Access plane(const char* name, unsigned axis) {
        const auto array = [this, axis] {
            for (std::size_t k = 0; k < kCells; ++k) {
                Zyx begin = {4 * cells_[k].z, 4 * cells_[k].y, 4 * cells_[k].x}, size = {4, 4, 4};
                std::size_t* const b[3] = {&begin.z, &begin.y, &begin.x};
                std::size_t* const s[3] = {&size.z, &size.y, &size.x};
                *b[axis] += k % 4;
                *s[axis] = 1;
                array_.fetch(begin, size, out_.data() + 16 * k * Unit);
            }
        };
        const auto code = [this, axis] {
            for (std::size_t k = 0; k < kCells; ++k) {
                reader_.plane(cells_[k], axis, k % 4, out_.data() + 16 * k * Unit);
            }
        };
        return {name, 16 * kCells, {{"array", array}, {"code", code}}};
    }

    Access cell() {
        const auto voxel_by_voxel = [this](Zyx at, std::byte* out) {
            array_.fetch({4 * at.z, 4 * at.y, 4 * at.x}, {4, 4, 4}, out);
        };
        const auto by_rows = [this](Zyx at, std::byte* out) { array_.copy_cell(at, out); };
        const auto coded = [this](Zyx at, std::byte* out) { reader_.cell(at, out); };
        Access access{"cell",
                      64 * kCells,
                      {{"array", [=, this] { each_cell(voxel_by_voxel, out_.data()); }},
                       {"array_rows", [=, this] { each_cell(by_rows, out_.data()); }},
                       {"code", [=, this] { each_cell(coded, out_.data()); }}}};
        add_flags(access, [this](const FlagsReader& r) {
            each_cell([&](Zyx at, std::byte* out) { r.cell(at, out); }, out_.data());
        });
        return access;
    }

    // Many cells in one call, where the coding allows for that.
    Access cells() {
        Access access = cell();
        access.name = "cells";
        access.ways.resize(2);
        access.ways.push_back({"code", [this] { reader_.cells(cells_, out_.data()); }});
        add_flags(access, [this](const FlagsReader& r) { r.cells(cells_, out_.data()); });
        return access;
    }

    Access volume() {
        const Zyx shape = array_.shape;
        return {"volume",
                shape.z * shape.y * shape.x,
                {{"array", [this, shape] { array_.fetch({}, shape, out_.data()); }},
                 {"code", [this] { reader_.level(0, out_.data(), 1); }}}};
    }

    const ZerobitReader& reader_;
    Array<Unit> array_;
    std::unique_ptr<FlagsReader> table_, instruction_;
    std::vector<Zyx> positions_, slices_, cells_;
    Bytes out_;
};

template <std::size_t Unit>
void measure(const Bytes& voxels, const Bytes& code, const ZerobitReader& reader, unsigned rounds) {
    Measurement<Unit> measurement(voxels, code, reader);
    if (!measurement.same_voxels()) fail("the older coding gives other voxels", "flags");
    print(measurement.run(rounds), measurement.flags_nbytes());
}

int run(int argc, char** argv) {
    if (argc != 4) {
        std::fprintf(stderr, "usage: zerobit_access VOXELS CODE ROUNDS\n");
        return 2;
    }
    const Bytes voxels = read_file(argv[1]), code = read_file(argv[2]);
    std::unique_ptr<ZerobitReader> reader;
    if (ZerobitReader::open(code, {}, reader).status != ZerobitStatus::ok ||
        reader->check().status != ZerobitStatus::ok) {
        fail("not a zerobit code", argv[2]);
    }
    const ZerobitHeader& h = reader->header();
    const std::size_t unit = h.channels * sample_nbytes(h.type);
    if (voxels.size() != h.shape.z * h.shape.y * h.shape.x * unit) {
        fail("not of the shape of the code", argv[1]);
    }
    const auto rounds = static_cast<unsigned>(std::max(1, std::atoi(argv[3])));
    switch (unit) {
        case 1: measure<1>(voxels, code, *reader, rounds); break;
        case 2: measure<2>(voxels, code, *reader, rounds); break;
        case 3: measure<3>(voxels, code, *reader, rounds); break;
        case 6: measure<6>(voxels, code, *reader, rounds); break;
        default: fail("float32 has no older coding to compare with", argv[2]);
    }
    return 0;
}

}  // namespace
}  // namespace octobrick::bench

int main(int argc, char** argv) { return octobrick::bench::run(argc, argv); }
