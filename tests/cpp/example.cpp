// Everything that the codec does, once, to a volume of 64³ voxels: docs/cpp.md shows this file.

#include <octobrick/codec.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <span>
#include <vector>

using namespace octobrick::codec;

namespace {

constexpr std::size_t kEdge = 64;
constexpr Zyx kShape = {kEdge, kEdge, kEdge};
constexpr Strides kStrides = {kEdge * kEdge * sizeof(float), kEdge * sizeof(float), sizeof(float)};
constexpr std::size_t kVoxels = kEdge * kEdge * kEdge;

void require(bool condition, const char* what) {
    if (!condition) {
        std::fprintf(stderr, "%s\n", what);
        std::exit(1);
    }
}

// A ball whose values fall from 1000 in its centre to 0 at its surface.
std::vector<float> ball() {
    std::vector<float> voxels(kVoxels);
    for (std::size_t i = 0; i < kVoxels; ++i) {
        const double x = static_cast<double>(i % kEdge) - 31.5;
        const double y = static_cast<double>(i / kEdge % kEdge) - 31.5;
        const double z = static_cast<double>(i / kEdge / kEdge) - 31.5;
        const double radius = std::sqrt(x * x + y * y + z * z);
        voxels[i] = static_cast<float>(1000 * std::fmax(0, 1 - radius / 32));
    }
    return voxels;
}

ConstVolume view(const std::vector<float>& voxels) {
    const auto bytes = std::as_bytes(std::span(voxels));
    return {bytes.data(), SampleType::f32, kShape, kStrides};
}

// The root of the mean squared difference.
double rms_error(const std::vector<float>& a, const std::vector<float>& b) {
    ErrorStats stats;
    require(compare(view(a), view(b), stats), "types and shapes are equal");
    return std::sqrt(stats.squares_f / static_cast<double>(stats.count));
}

struct Decoded {
    std::vector<float> voxels;
    std::vector<float> bounds;  // by how much the voxels of each block may be wrong
};

// Fixed rate: 4 bits a voxel, and two end points for every block of 8³.
Decoded through_s3dc(const std::vector<float>& voxels) {
    const S3dc codec{{8, 8, 8}, 4};
    Layout layout;
    require(make_layout(codec, SampleType::f32, kShape, layout) == Status::ok, "a layout");
    std::vector<std::byte> code(layout.nbytes);
    require(encode(codec, view(voxels), code).status == Status::ok, "finite voxels encode");

    Decoded decoded;
    decoded.voxels.resize(kVoxels);
    const auto bytes = std::as_writable_bytes(std::span(decoded.voxels));
    const Volume out{bytes.data(), SampleType::f32, kShape, kStrides};
    require(decode(codec, code, out).status == Status::ok, "a code decodes");
    std::printf("s3dc: %zu bytes, error %.2f\n", code.size(), rms_error(voxels, decoded.voxels));

    // Half of one of the 15 steps between the end points, which are what a code begins with.
    float ends[2];
    for (std::size_t at = 0; at < layout.end_points_nbytes; at += sizeof ends) {
        std::memcpy(ends, &code[at], sizeof ends);
        decoded.bounds.push_back((ends[1] - ends[0]) / 15 / 2);
    }

    code.pop_back();  // damaged: the outcome says how
    require(decode(codec, code, out).status == Status::wrong_nbytes, "a short code is refused");
    return decoded;
}

// A width for each block, so that no voxel is off by more than 2.
void through_bounded_s3dc(const std::vector<float>& voxels) {
    const VariableS3dc codec{{8, 8, 8}, {WidthRule::Kind::bound, 2}};
    std::vector<std::byte> code;
    require(encode_variable(codec, view(voxels), nullptr, code).status == Status::ok, "encodes");

    std::vector<float> decoded(kVoxels);
    const auto bytes = std::as_writable_bytes(std::span(decoded));
    const Volume out{bytes.data(), SampleType::f32, kShape, kStrides};
    require(decode_variable(codec.block, code, nullptr, out).status == Status::ok, "decodes");
    ErrorStats stats;
    require(compare(view(voxels), view(decoded), stats), "types and shapes are equal");
    require(stats.max_abs_f <= 2, "the bound is kept");
    std::printf("bounded s3dc: %zu bytes, error %.2f\n", code.size(), rms_error(voxels, decoded));
}

// Smooths across the borders of the blocks, by no more than they may be wrong.
void deblocked(const std::vector<float>& voxels, const Decoded& decoded) {
    Deblock filter;
    filter.block = {8, 8, 8};
    std::vector<float> smooth(kVoxels);
    require(deblock(filter, decoded.voxels, kShape, decoded.bounds, smooth) == kAllFinite,
            "finite voxels are smoothed");
    std::printf("deblock: error %.2f\n", rms_error(voxels, smooth));
}

// The direction of the gradient at a voxel, in three bytes: here it points to the centre.
void directions(const std::vector<float>& voxels) {
    std::vector<float> gradient(3 * kVoxels);
    const double spacing_zyx[3] = {1, 1, 1};
    require(central_differences(view(voxels), spacing_zyx, gradient) == kAllFinite, "gradients");
    std::vector<std::uint8_t> codes(gradient.size());
    require(encode_directions(std::span<const float>(gradient), codes) == kAllFinite, "codes");
    std::vector<float> decoded(gradient.size());
    decode_directions(codes, decoded);
    const std::size_t at = 3 * ((32 * kEdge + 32) * kEdge + 10);
    std::printf("direction: %.2f %.2f %.2f\n", decoded[at], decoded[at + 1], decoded[at + 2]);
}

// Wavelets: 5 % of the coefficients, and any voxel by itself.
void through_zerobit(const std::vector<float>& voxels) {
    const auto bytes = std::as_bytes(std::span(voxels));
    const ZerobitVolume volume{bytes.data(), SampleType::f32, 1, kShape};
    std::vector<std::byte> code;
    require(zerobit_encode(volume, {}, {}, {}, code).status == ZerobitStatus::ok, "encodes");

    std::unique_ptr<ZerobitReader> reader;
    require(ZerobitReader::open(code, {}, reader).status == ZerobitStatus::ok, "a sound header");
    require(reader->check().status == ZerobitStatus::ok, "sound unit blocks");
    const Zyx centre{31, 31, 31};
    float voxel;
    reader->voxels({&centre, 1}, reinterpret_cast<std::byte*>(&voxel));
    std::printf("zerobit: %zu bytes, centre %.0f\n", code.size(), voxel);
}

}  // namespace

int main() {
    const std::vector<float> voxels = ball();
    deblocked(voxels, through_s3dc(voxels));
    through_bounded_s3dc(voxels);
    directions(voxels);
    through_zerobit(voxels);
}
