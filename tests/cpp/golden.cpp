// Decodes the golden vectors on this machine, with each of its instruction sets, and encodes them
// again where the format says how:
//
//     golden tests/golden

#include <cstring>

#include "check.h"

namespace {

namespace fs = std::filesystem;
using namespace octobrick::codec;

std::vector<fs::path> codes_in(const fs::path& folder) {
    std::vector<fs::path> found;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
        if (entry.path().extension() == ".code") found.push_back(entry.path());
    }
    CHECK_OF(!found.empty(), folder.string());
    return found;
}

Bytes beside(const fs::path& code, const char* extension) {
    return read_file(fs::path(code).replace_extension(extension));
}

SampleType type_named(const std::string& name) {
    static constexpr const char* kNames[] = {"uint8", "int8", "uint16", "int16", "float32"};
    for (unsigned i = 0; i < std::size(kNames); ++i) {
        if (name == kNames[i]) return static_cast<SampleType>(i);
    }
    CHECK_OF(false, name);
}

// Names say the parameters: float32-1x2x16-blocks1x2x16-3bit-denormal
void check_s3dc(const fs::path& path) {
    const std::string name = path.stem().string();
    Zyx shape, block;
    unsigned bits = 0;
    char type[8];
    CHECK_OF(std::sscanf(name.c_str(), "%7[^-]-%zux%zux%zu-blocks%zux%zux%zu-%ubit", type, &shape.z,
                         &shape.y, &shape.x, &block.z, &block.y, &block.x, &bits) == 8,
             name);
    const S3dc codec{block, bits};
    const SampleType sample = type_named(type);
    const Bytes code = read_file(path), voxels = beside(path, ".voxels");
    const Bytes expected = beside(path, ".decoded");
    CHECK_OF(expected.size() == shape.z * shape.y * shape.x * sample_nbytes(sample), name);
    CHECK_OF(voxels.size() == expected.size(), name);
    for (const Execution execution : kExecutions) {
        Bytes decoded(expected.size()), again(code.size());
        const auto out = packed<Volume>(decoded.data(), sample, shape);
        CHECK_OF(decode(codec, code, out, execution).status == Status::ok, name);
        CHECK_OF(decoded == expected, name);
        const auto in = packed<ConstVolume>(voxels.data(), sample, shape);
        CHECK_OF(encode(codec, in, again, execution).status == Status::ok, name);
        CHECK_OF(again == code, name);
    }
}

void check_directions(const fs::path& path) {
    const Bytes code = read_file(path), expected = beside(path, ".decoded");
    CHECK_OF(expected.size() == code.size() * sizeof(float), path.string());
    std::vector<std::uint8_t> codes(code.size());
    std::memcpy(codes.data(), code.data(), code.size());
    const bool from_vectors = fs::exists(fs::path(path).replace_extension(".vectors"));
    std::vector<double> vectors(codes.size());
    if (from_vectors) {
        const Bytes stored = beside(path, ".vectors");
        CHECK_OF(stored.size() == vectors.size() * sizeof(double), path.string());
        std::memcpy(vectors.data(), stored.data(), stored.size());
    }
    for (const Execution execution : kExecutions) {
        std::vector<float> decoded(codes.size());
        decode_directions(codes, decoded, execution);
        CHECK_OF(std::memcmp(decoded.data(), expected.data(), expected.size()) == 0, path.string());
        if (!from_vectors) continue;
        std::vector<std::uint8_t> again(codes.size());
        CHECK(encode_directions(std::span<const double>(vectors), again, execution) == kAllFinite);
        CHECK_OF(again == codes, path.string());
    }
}

void check_zerobit(const fs::path& path) {
    const Bytes code = read_file(path), expected = beside(path, ".decoded");
    Bytes codebook;
    if (fs::exists(fs::path(path).replace_extension(".codebook"))) {
        codebook = beside(path, ".codebook");
    }
    std::unique_ptr<ZerobitReader> reader;
    CHECK_OF(ZerobitReader::open(code, codebook, reader).status == ZerobitStatus::ok,
             path.string());
    CHECK_OF(reader->check().status == ZerobitStatus::ok, path.string());
    const ZerobitHeader& header = reader->header();
    Bytes decoded(header.shape.z * header.shape.y * header.shape.x * header.channels *
                  sample_nbytes(header.type));
    CHECK_OF(decoded.size() == expected.size(), path.string());
    reader->level(0, decoded.data());
    CHECK_OF(decoded == expected, path.string());
}

}  // namespace

int main(int count, char** arguments) {
    if (count != 2) {
        std::fprintf(stderr, "usage: golden FOLDER\n");
        return 2;
    }
    constexpr struct {
        const char* folder;
        void (*check)(const fs::path&);
    } kFamilies[] = {
        {"s3dc", check_s3dc}, {"gradients", check_directions}, {"zerobit", check_zerobit}};
    for (const auto& family : kFamilies) {
        const std::vector<fs::path> codes = codes_in(fs::path(arguments[1]) / family.folder);
        for (const fs::path& code : codes) family.check(code);
        std::printf("%s: %zu codes\n", family.folder, codes.size());
    }
}
