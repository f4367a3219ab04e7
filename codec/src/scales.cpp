#include "scales.h"

#include <algorithm>
#include <cmath>

#include "block_voxels.h"
#include "rows.h"
#include "s3dc_variable_format.h"

namespace octobrick::codec::detail {

namespace {

// What training looks at: enough for seven curves, and a few milliseconds.
constexpr std::size_t kMostBlocks = 1024;
constexpr std::size_t kMostVoxels = 64;  // of a block
constexpr int kRounds = 6;

// A block's voxels as positions, and how much an error of a position weighs in voxels.
struct Sample {
    std::vector<std::uint16_t> positions;
    double weight;
};

// Blocks at even distances, of each voxels at even distances. Those that the linear scale codes
// exactly have no say.
template <class T>
std::vector<Sample> take_samples(const S3dc& codec, const ConstVolume& voxels) {
    const Zyx shape = voxels.shape;
    const Zyx block = {std::min(codec.block.z, shape.z), std::min(codec.block.y, shape.y),
                       std::min(codec.block.x, shape.x)};
    const Zyx grid = {(shape.z - 1) / block.z + 1, (shape.y - 1) / block.y + 1,
                      (shape.x - 1) / block.x + 1};
    const std::size_t blocks = grid.z * grid.y * grid.x;
    const std::size_t count = std::min(blocks, kMostBlocks);
    SlabRows<T, ConstVolume> rows(voxels, block);
    BlockVoxels<T> gathered(block.z * block.y * block.x);
    std::vector<Sample> samples;
    for (std::size_t i = 0; i < count; ++i) {
        const Zyx at = place_of(i * blocks / count, grid);
        const Zyx extent = extent_of(at, block, shape);
        const Zyx begin = {at.z * block.z, at.y * block.y, 0};
        rows.open(begin, {begin.z + extent.z, begin.y + extent.y, 0});
        gathered.gather(rows, at.x * block.x, extent);
        const Range<T> range = Range<T>::of(gathered.values.data(), gathered.n);
        const double reach = static_cast<double>(range.max) - static_cast<double>(range.min);
        if (reach <= (std::is_integral_v<T> ? (1 << codec.bits) - 1 : 0)) continue;
        Sample sample{{}, range.unit() * range.reach() * range.unit() * range.reach()};
        const std::size_t step = (gathered.n - 1) / kMostVoxels + 1;
        for (std::size_t k = 0; k < gathered.n; k += step) {
            sample.positions.push_back(position_of(gathered.values[k], range));
        }
        samples.push_back(std::move(sample));
    }
    return samples;
}

// Where a voxel at t in [0, 1] of the way lies: seven shapes to begin with, dense at one end, at
// both, or in the middle.
double first_shape(std::size_t scale, double t) {
    const double s = 2 * t - 1;
    switch (scale) {
        case 1: return t * t;
        case 2: return 1 - (1 - t) * (1 - t);
        case 3: return std::pow(t, 1.4);
        case 4: return 1 - std::pow(1 - t, 1.4);
        case 5: return (s * s * s + 1) / 2;
        case 6: return (0.4 * s + 0.6 * s * s * s + 1) / 2;
        case 7: return (1 - std::cos(t * 3.141592653589793)) / 2;
    }
    return t;
}

// The mean of the positions nearest to each index becomes its place; the ends stay.
void move_indices(const ScaleChooser& chooser, std::size_t scale,
                  const std::array<double, ScaleChooser::kSteps>& weights, unsigned bits,
                  Scales& scales) {
    std::array<double, kMostIndices> sum{}, weight{};
    for (std::size_t step = 0; step < ScaleChooser::kSteps; ++step) {
        const unsigned index = chooser.nearest(scale, step);
        const double centre = (static_cast<double>(step) + 0.5) * (1 << ScaleChooser::kStepShift);
        sum[index] += centre * weights[step];
        weight[index] += weights[step];
    }
    const std::size_t last = (std::size_t{1} << bits) - 1;
    for (std::size_t i = 1; i < last; ++i) {
        if (weight[i] > 0) scales[scale][i] = static_cast<std::uint16_t>(sum[i] / weight[i] + 0.5);
    }
    std::sort(scales[scale].begin(), scales[scale].begin() + static_cast<std::ptrdiff_t>(last) + 1);
}

}  // namespace

ScaleChooser::ScaleChooser(const Scales& scales, unsigned bits) : squares_(kSteps) {
    const std::size_t last = (std::size_t{1} << bits) - 1;
    for (std::size_t scale = 0; scale < kScales; ++scale) {
        std::size_t index = 0;
        for (std::size_t step = 0; step < kSteps; ++step) {
            const double centre = (static_cast<double>(step) + 0.5) * (1 << kStepShift);
            const auto distance = [&](std::size_t i) {
                return std::fabs(scales[scale][i] - centre);
            };
            while (index < last && distance(index + 1) < distance(index)) ++index;
            nearest_[scale][step] = static_cast<std::uint8_t>(index);
            squares_[step][scale] = static_cast<float>(distance(index) * distance(index));
        }
    }
}

unsigned ScaleChooser::best(const std::uint16_t* positions, std::size_t n) const {
    std::array<double, kScales> sums{};
    for (std::size_t i = 0; i < n; ++i) {
        const std::array<float, kScales>& squares = squares_[positions[i] >> kStepShift];
        for (std::size_t scale = 0; scale < kScales; ++scale) {
            sums[scale] += static_cast<double>(squares[scale]);
        }
    }
    return static_cast<unsigned>(std::min_element(sums.begin(), sums.end()) - sums.begin());
}

Scales train_scales(const S3dc& codec, const ConstVolume& voxels) {
    const std::vector<Sample> samples =
        with_sample_type(voxels.type, [&]<class T>(T) { return take_samples<T>(codec, voxels); });
    const std::size_t indices = std::size_t{1} << codec.bits;
    Scales scales{};
    for (std::size_t scale = 0; scale < kScales; ++scale) {
        for (std::size_t i = 0; i < indices; ++i) {
            const double t = static_cast<double>(i) / static_cast<double>(indices - 1);
            scales[scale][i] = static_cast<std::uint16_t>(first_shape(scale, t) * kScaleTop + 0.5);
        }
    }
    for (int round = 0; round < kRounds; ++round) {
        const ScaleChooser chooser(scales, codec.bits);
        std::vector<std::array<double, ScaleChooser::kSteps>> weights(kScales);
        for (const Sample& sample : samples) {
            auto& to = weights[chooser.best(sample.positions.data(), sample.positions.size())];
            for (const std::uint16_t position : sample.positions) {
                to[position >> ScaleChooser::kStepShift] += sample.weight;
            }
        }
        for (std::size_t scale = 1; scale < kScales; ++scale) {
            move_indices(chooser, scale, weights[scale], codec.bits, scales);
        }
    }
    return scales;
}

}  // namespace octobrick::codec::detail
