// Hostile codes with a width per block, predictions and scales: whatever the bytes, decoding ends
// with a status, touches nothing that is not its own, and says the same with every set of
// instructions. What it accepts is finite, and encodes again with any rule. Without prediction and
// scales, a sampler opens what decodes, and gives its voxels; it says the same of the rest.
//
// The first 10 bytes choose the parameters. If the last of them is even, the rest is a code.
// Otherwise it makes a volume, whose code is changed at a few places: so mutations get behind
// tables.

#include <algorithm>
#include <cstring>
#include <memory>
#include <vector>

#include "fuzz.h"
#include "octobrick/codec/s3dc_sampler.h"
#include "octobrick/codec/s3dc_variable.h"
#include "sample_everywhere.h"

namespace {

using namespace octobrick::codec;

using Block = octobrick::fuzz::Exact<std::byte>;

struct Parameters {
    SampleType type;
    Zyx shape, block;
    bool predicted, scaled, fitted;
    unsigned bits;
    WidthRule rule;

    explicit Parameters(const std::uint8_t* data)
        : type(static_cast<SampleType>(data[0] % 5)),
          shape{1 + data[1] % 6u, 1 + data[2] % 9u, 1 + data[3] % 90u},
          block{data[4] % 9u, data[5] % 9u, data[6] % 33u},
          predicted((data[7] & 1) != 0),
          scaled((data[7] & 2) != 0),
          fitted((data[7] & 4) != 0),
          bits(1 + data[8] % 8u),
          rule{static_cast<WidthRule::Kind>(data[7] >> 4 & 3), double(data[8] % 9u)} {}

    std::size_t nbytes() const { return shape.z * shape.y * shape.x * sample_nbytes(type); }
};

template <class View, class Byte>
View packed(Byte* origin, const Parameters& p) {
    const auto unit = static_cast<std::ptrdiff_t>(sample_nbytes(p.type));
    const auto row = unit * static_cast<std::ptrdiff_t>(p.shape.x);
    return {origin, p.type, p.shape, {row * static_cast<std::ptrdiff_t>(p.shape.y), row, unit}};
}

Outcome decode_any(const Parameters& p, std::span<const std::byte> code,
                   const ConstVolume* prediction, const Volume& voxels, Execution execution) {
    if (p.scaled) return decode({p.block, p.bits, false, true}, code, voxels, execution);
    return decode_variable(p.block, code, prediction, voxels, execution);
}

// The code of voxels; empty where they are refused.
std::vector<std::byte> encode_any(const Parameters& p, const ConstVolume& voxels,
                                  const ConstVolume* prediction) {
    std::vector<std::byte> code;
    if (!p.scaled) {
        const Outcome outcome =
            encode_variable({p.block, p.rule, p.fitted}, voxels, prediction, code);
        return outcome.status == Status::ok ? code : std::vector<std::byte>{};
    }
    const S3dc codec{p.block, p.bits, false, true};
    Layout layout;
    if (make_layout(codec, p.type, p.shape, layout) != Status::ok) return {};
    code.resize(layout.nbytes);
    return encode(codec, voxels, code).status == Status::ok ? code : std::vector<std::byte>{};
}

// Opens what decoded with this outcome, and compares all voxels with nearest samples.
template <class T>
void sample(const Parameters& p, std::span<const std::byte> code, const Outcome& outcome,
            const std::byte* decoded) {
    std::unique_ptr<S3dcSampler> sampler, scalar;
    const Outcome opened = S3dcSampler::open_variable(p.block, p.type, p.shape, code, sampler);
    REQUIRE(opened.status == outcome.status && opened.at == outcome.at);
    S3dcSampler::open_variable(p.block, p.type, p.shape, code, scalar, false);
    REQUIRE((sampler != nullptr) == (outcome.status == Status::ok));
    if (sampler == nullptr) return;
    octobrick::fuzz::sample_everywhere(*sampler, *scalar, code, p.shape);
    std::vector<float> centres;
    for (std::size_t z = 0; z < p.shape.z; ++z) {
        for (std::size_t y = 0; y < p.shape.y; ++y) {
            for (std::size_t x = 0; x < p.shape.x; ++x) {
                centres.insert(centres.end(),
                               {static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f,
                                static_cast<float>(z) + 0.5f});
            }
        }
    }
    const SamplePoints points{std::span<const float>(centres)};
    std::vector<float> found(points.size());
    for (const Sampling how : {Sampling::nearest, Sampling::trilinear_shared}) {
        sampler->sample(how, points, found.data());
        for (std::size_t k = 0; k < found.size(); ++k) {
            T voxel;
            std::memcpy(&voxel, decoded + k * sizeof voxel, sizeof voxel);
            REQUIRE(found[k] == static_cast<float>(voxel));
        }
    }
}

void sample_any(const Parameters& p, std::span<const std::byte> code, const Outcome& outcome,
                const std::byte* decoded) {
    switch (p.type) {
        case SampleType::u8: return sample<std::uint8_t>(p, code, outcome, decoded);
        case SampleType::i8: return sample<std::int8_t>(p, code, outcome, decoded);
        case SampleType::u16: return sample<std::uint16_t>(p, code, outcome, decoded);
        case SampleType::i16: return sample<std::int16_t>(p, code, outcome, decoded);
        case SampleType::f32: return sample<float>(p, code, outcome, decoded);
    }
}

// Decodes with every set of instructions; what is accepted encodes again.
bool read(const Parameters& p, std::span<const std::byte> given) {
    const Block code(given), prediction(p.nbytes()), first(p.nbytes());
    const auto predicted = packed<ConstVolume>(prediction.data(), p);
    const ConstVolume* use = p.predicted ? &predicted : nullptr;
    const Outcome outcome = decode_any(p, code.span(), use, packed<Volume>(first.data(), p), {});
    for (const Execution execution : octobrick::fuzz::kExecutions) {
        const Block second(p.nbytes());
        const Outcome other =
            decode_any(p, code.span(), use, packed<Volume>(second.data(), p), execution);
        REQUIRE(outcome.status == other.status && outcome.at == other.at);
        REQUIRE(outcome.status != Status::ok ||
                std::memcmp(first.data(), second.data(), p.nbytes()) == 0);
    }
    if (!p.predicted && !p.scaled) sample_any(p, code.span(), outcome, first.data());
    if (outcome.status != Status::ok) return false;
    std::vector<std::byte> again;
    const VariableS3dc exact{p.block, {WidthRule::Kind::bound, 0}, false};
    const auto voxels = packed<ConstVolume>(first.data(), p);
    REQUIRE(encode_variable(exact, voxels, nullptr, again).status == Status::ok);
    return true;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    constexpr std::size_t kParameters = 10, kChange = 3;
    if (size < kParameters + 4) return 0;
    const Parameters p(data);
    const std::span<const std::byte> rest(reinterpret_cast<const std::byte*>(data) + kParameters,
                                          size - kParameters);
    if (data[9] % 2 == 0) {
        read(p, rest);
        return 0;
    }
    const std::size_t changes = data[9] / 2 % 8u;
    if (rest.size() < kChange * changes + 4) return 0;
    const std::span<const std::byte> samples = rest.subspan(kChange * changes);
    const Block voxels(p.nbytes()), prediction(p.nbytes());
    for (std::size_t i = 0; i < p.nbytes(); ++i) {
        voxels.data()[i] = samples[(i * i / 64 + i) % samples.size()];
    }
    const auto predicted = packed<ConstVolume>(prediction.data(), p);
    std::vector<std::byte> code = encode_any(p, packed<ConstVolume>(voxels.data(), p),
                                             p.predicted && !p.scaled ? &predicted : nullptr);
    if (code.empty()) return 0;
    REQUIRE(read(p, code));
    for (std::size_t i = 0; i < changes; ++i) {
        const std::byte* change = rest.data() + kChange * i;
        const auto at =
            static_cast<std::size_t>(change[0]) << 8 | static_cast<std::size_t>(change[1]);
        code[at % code.size()] ^= change[2];
    }
    read(p, code);
    return 0;
}
