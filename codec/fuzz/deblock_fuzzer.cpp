// Any finite voxels, strength and bounds: what the filter writes is finite, within the least and
// the greatest voxel, and no further from each voxel than its bound. What is not finite is found.
//
// The first bytes choose the parameters; the rest are floats, voxels and then bounds.

#include "octobrick/codec/deblock.h"

#include <cmath>
#include <cstring>

#include "fuzz.h"
#include "octobrick/codec/gradients.h"

namespace {

using namespace octobrick::codec;
using octobrick::fuzz::Exact, octobrick::fuzz::kExecutions;

// Takes an input apart; behind its end are zeros.
class Input {
  public:
    Input(const std::uint8_t* data, std::size_t size) : rest_(data, size) {}
    template <class T>
    T next() {
        T value{};
        const std::size_t n = std::min(sizeof value, rest_.size());
        if (n > 0) std::memcpy(&value, rest_.data(), n);
        rest_ = rest_.subspan(n);
        return value;
    }
    std::size_t below(unsigned end) { return next<std::uint8_t>() % end; }

  private:
    std::span<const std::uint8_t> rest_;
};

// What the contract asks of a bound, a strength and a range.
template <class T>
T not_negative(T value) {
    return std::isnan(value) ? T{0} : std::fabs(value);
}
template <class T>
T finite(T value) {
    return std::isfinite(value) ? value : T{0};
}

// What rounding to float may add, where anything may.
double slack_of(float value, double slack) { return slack > 0 ? std::fabs(double{value}) : 0; }

Deblock any_filter(Input& input) {
    Deblock filter;
    filter.block = {1 + input.below(9), 1 + input.below(9), 1 + input.below(9)};
    filter.axes = static_cast<DeblockAxes>(input.below(2));
    filter.limit = static_cast<DeblockLimit>(input.below(3));
    filter.strength = finite(input.next<double>());
    filter.value_range = finite(not_negative(input.next<double>()));
    filter.low = finite(input.next<float>());
    filter.high = finite(input.next<float>());
    return filter;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    Input input(data, size);
    const Zyx shape = {1 + input.below(10), 1 + input.below(10), 1 + input.below(20)};
    const std::size_t voxels = shape.z * shape.y * shape.x;
    const Deblock filter = any_filter(input);
    const Zyx b = filter.block;
    const std::size_t blocks =
        ((shape.z + b.z - 1) / b.z) * ((shape.y + b.y - 1) / b.y) * ((shape.x + b.x - 1) / b.x);
    const std::size_t counts[] = {0, blocks, voxels};
    const Exact<float> bounds(counts[input.below(3)]);
    const bool keep_finite = input.below(8) != 0;

    const Exact<float> volume(voxels);
    for (float& v : volume.span()) {
        v = input.next<float>();
        if (keep_finite) v = finite(v);
    }
    for (float& q : bounds.span()) q = not_negative(input.next<float>());
    std::size_t first = 0;
    while (first < voxels && std::isfinite(volume[first])) ++first;
    const std::size_t expected = first < voxels ? first : kAllFinite;

    const Exact<float> out(voxels);
    REQUIRE(deblock(filter, volume.span(), shape, bounds.span(), out.span()) == expected);
    for (const Execution execution : kExecutions) {
        const Exact<float> same(voxels);
        REQUIRE(deblock(filter, volume.span(), shape, bounds.span(), same.span(), execution) ==
                expected);
        REQUIRE(expected != kAllFinite ||
                std::memcmp(out.data(), same.data(), voxels * sizeof(float)) == 0);
    }
    if (expected != kAllFinite) return 0;
    const auto [least, greatest] = std::minmax_element(volume.span().begin(), volume.span().end());
    // Of a part by no more than rounding, as long as it is within the whole.
    const double slack = filter.low < filter.high ? 1e-6 * (double{*greatest} - *least) : 0;
    const double low = *least - slack - 1.2e-7 * slack_of(*least, slack);
    const double high = *greatest + slack + 1.2e-7 * slack_of(*greatest, slack);
    const bool bounded_each = bounds.span().size() == voxels;
    for (std::size_t i = 0; i < voxels; ++i) {
        REQUIRE(out[i] >= low && out[i] <= high);
        const double rounding = 1.2e-7 * std::fabs(out[i]) + 1e-45;  // to float
        const double moved = std::fabs(double{out[i]} - double{volume[i]});
        REQUIRE(!bounded_each || moved <= double{bounds[i]} * (1 + 1e-12) + rounding);
    }
    return 0;
}
