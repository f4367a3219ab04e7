#include <algorithm>
#include <bit>

#include "guarded_parallel.h"
#include "zerobit_analysis.h"
#include "zerobit_codebook.h"

namespace octobrick::codec {
namespace detail {
namespace {

ZerobitOutcome require_volume(const ZerobitVolume& v) {
    if (!supported(v.type, v.channels)) return {ZerobitStatus::unsupported_type, {}, 0, 0};
    if (v.shape.z == 0 || v.shape.y == 0 || v.shape.x == 0) {
        return {ZerobitStatus::empty_shape, {}, 0, 0};
    }
    ZerobitHeader header;
    header.type = v.type;
    header.channels = v.channels;
    header.shape = v.shape;
    return {lay_out(header) ? ZerobitStatus::ok : ZerobitStatus::too_large, {}, 0, 0};
}

unsigned threads_for(const ZerobitVolume& v, unsigned threads) {
    const Zyx grid = ceil_div(v.shape, kBlock);
    const std::size_t voxels = v.shape.z * v.shape.y * v.shape.x;
    return choose_threads(threads, voxels * v.channels * sample_nbytes(v.type),
                          grid.z * grid.y * grid.x);
}

bool whole_numbers(SampleType type) { return type != SampleType::f32; }

template <class Member>
std::vector<ZerobitColour> collect(const std::vector<KeptBlock>& kept, Member member) {
    std::vector<ZerobitColour> all;
    for (const KeptBlock& block : kept) {
        all.insert(all.end(), (block.*member).begin(), (block.*member).end());
    }
    return all;
}

Codebook make_codebook(const ZerobitVolume& v, const Palette& averages, const Palette& details) {
    const bool whole = whole_numbers(v.type);
    return {v.type, v.channels, median_cut(averages, whole), median_cut(details, whole)};
}

// The index of every colour of `all`, in that order.
std::vector<std::uint8_t> indices_of(const std::vector<ZerobitColour>& all,
                                     const std::vector<ZerobitColour>& codewords,
                                     unsigned threads) {
    if (all.empty()) return {};
    Palette palette;
    add_colours(palette, all);
    const std::vector<std::uint8_t> of_palette = nearest(palette.colours, codewords, threads);
    std::vector<std::uint8_t> indices(all.size());
    std::transform(all.begin(), all.end(), indices.begin(), [&](const ZerobitColour& colour) {
        const auto at = std::lower_bound(palette.colours.begin(), palette.colours.end(), colour);
        return of_palette[static_cast<std::size_t>(at - palette.colours.begin())];
    });
    return indices;
}

// One unit block in the paper's structure. Takes the indices it needs from both streams.
void append_block(const KeptBlock& kept, const std::uint8_t*& averages,
                  const std::uint8_t*& details, std::vector<std::byte>& out) {
    const auto put = [&out](auto value) {
        const auto* from = reinterpret_cast<const std::byte*>(&value);
        out.insert(out.end(), from, from + sizeof value);
    };
    put(static_cast<std::uint8_t>(kept.cells.size()));
    if (kept.cells.empty()) return;

    std::uint64_t flags = 0;
    std::vector<std::uint8_t> maps;  // ZSMS
    struct Offsets {
        std::size_t detail, zerobit;
        bool level0;
    };
    std::vector<Offsets> offsets;
    std::size_t detail = 0;
    for (const KeptCell& cell : kept.cells) {
        flags |= std::uint64_t{1} << cell.number;
        offsets.push_back({detail, maps.size(), cell.maps[0] != 0});
        std::uint8_t zerobits = 0;
        for (unsigned node = 1; node < kNodes; ++node) {
            if (cell.maps[node] != 0) {
                zerobits = static_cast<std::uint8_t>(zerobits | 1u << (node - 1));
            }
        }
        maps.push_back(zerobits);
        for (unsigned node = 0; node < kNodes; ++node) {
            if (const std::uint8_t map = cell.maps[node]; map != 0) {
                maps.push_back(static_cast<std::uint8_t>(node == 0 ? map | 0x80u : map));
                detail += static_cast<std::size_t>(std::popcount(map));
            }
        }
    }
    put(flags);
    for (const Offsets& of : offsets) {
        put(*averages++);
        put(static_cast<std::uint16_t>(maps.size() + of.detail));
        put(static_cast<std::uint16_t>(of.zerobit | (of.level0 ? 0x8000u : 0u)));
    }
    const auto* from = reinterpret_cast<const std::byte*>(maps.data());
    out.insert(out.end(), from, from + maps.size());
    from = reinterpret_cast<const std::byte*>(details);
    out.insert(out.end(), from, from + detail);
    details += detail;
}

void append_thresholds(const std::vector<KeptBlock>& kept, float step,
                       std::vector<std::byte>& code) {
    for (const KeptBlock& block : kept) {
        const double steps = step > 0 ? std::ceil(block.dropped / static_cast<double>(step)) : 0;
        code.push_back(static_cast<std::byte>(std::min(steps, 255.0)));
    }
}

// 255 steps reach the greatest threshold.
float threshold_step(const std::vector<KeptBlock>& kept) {
    double greatest = 0;
    for (const KeptBlock& block : kept) greatest = std::max(greatest, block.dropped);
    float step = static_cast<float>(greatest / 255);
    while (static_cast<double>(step) * 255 < greatest) {
        step = std::nextafter(step, std::numeric_limits<float>::infinity());
    }
    return step;
}

ZerobitOutcome write_code(const Analysis& a, const std::vector<KeptBlock>& kept,
                          const Codebook& book, std::span<const std::byte> shared,
                          std::vector<std::byte>& code, unsigned threads) {
    const auto averages = indices_of(collect(kept, &KeptBlock::averages), book.averages, threads);
    const auto details = indices_of(collect(kept, &KeptBlock::details), book.details, threads);
    std::vector<std::byte> blocks;
    std::vector<std::uint32_t> pointers;
    const std::uint8_t* next_average = averages.data();
    const std::uint8_t* next_detail = details.data();
    for (const KeptBlock& block : kept) {
        pointers.push_back(static_cast<std::uint32_t>(blocks.size()));
        append_block(block, next_average, next_detail, blocks);
    }

    ZerobitHeader h;
    h.type = a.volume.type;
    h.channels = a.volume.channels;
    h.shape = a.volume.shape;
    h.shared = !shared.empty();
    h.digest = h.shared ? digest(shared) : 0;
    h.average_count = book.averages.size();
    h.detail_count = book.details.size();
    h.background = a.background;
    h.least = a.least;
    h.greatest = a.greatest;
    h.threshold_step = threshold_step(kept);
    h.blocks_nbytes = blocks.size();
    if (!lay_out(h)) return {ZerobitStatus::too_large, {}, 0, 0};

    code.clear();
    code.reserve(h.nbytes);
    code.resize(kHeaderNbytes);
    write_header(h, code.data());
    if (!h.shared) append_codewords(book, code);
    append_thresholds(kept, h.threshold_step, code);
    const auto* from = reinterpret_cast<const std::byte*>(pointers.data());
    code.insert(code.end(), from, from + pointers.size() * sizeof(std::uint32_t));
    code.insert(code.end(), blocks.begin(), blocks.end());
    code.resize(h.nbytes);
    return {};
}

}  // namespace
}  // namespace detail

struct ZerobitTrainer::State {
    SampleType type;
    unsigned channels;
    ZerobitSettings settings;
    detail::Palette averages, details;
};

ZerobitTrainer::ZerobitTrainer(SampleType type, unsigned channels, const ZerobitSettings& settings)
    : state_(new State{type, channels, settings, {}, {}}) {}

ZerobitTrainer::~ZerobitTrainer() = default;

ZerobitOutcome ZerobitTrainer::add(const ZerobitVolume& volume, unsigned threads) {
    if (volume.type != state_->type || volume.channels != state_->channels) {
        return {ZerobitStatus::unsupported_type, {}, 0, 0};
    }
    ZerobitOutcome outcome = detail::require_volume(volume);
    if (outcome.status != ZerobitStatus::ok) return outcome;
    threads = detail::threads_for(volume, threads);
    detail::Analysis a{volume, state_->settings, {}, {}, {}, {}, 0, 0, 0};
    outcome = detail::survey(a, threads);
    if (outcome.status != ZerobitStatus::ok) return outcome;
    const auto kept = detail::keep_significant(a, threads);
    add_colours(state_->averages, detail::collect(kept, &detail::KeptBlock::averages));
    add_colours(state_->details, detail::collect(kept, &detail::KeptBlock::details));
    return {};
}

std::vector<std::byte> ZerobitTrainer::codebook() const {
    const ZerobitVolume like{nullptr, state_->type, state_->channels, {}};
    return detail::write_codebook(detail::make_codebook(like, state_->averages, state_->details));
}

ZerobitOutcome zerobit_encode(const ZerobitVolume& volume, const ZerobitSettings& settings,
                              std::span<const std::uint8_t> wanted,
                              std::span<const std::byte> codebook, std::vector<std::byte>& code,
                              unsigned threads) {
    using namespace detail;
    ZerobitOutcome outcome = require_volume(volume);
    if (outcome.status != ZerobitStatus::ok) return outcome;
    Codebook book;
    const ZerobitOutcome wrong{ZerobitStatus::wrong_codebook, {}, 0, 0};
    if (!codebook.empty() && (!read_codebook(codebook, book) || book.type != volume.type ||
                              book.channels != volume.channels)) {
        return wrong;
    }
    threads = threads_for(volume, threads);
    Analysis a{volume, settings, wanted, {}, {}, {}, 0, 0, 0};
    outcome = survey(a, threads);
    if (outcome.status != ZerobitStatus::ok) return outcome;
    const std::vector<KeptBlock> kept = keep_significant(a, threads);
    if (codebook.empty()) {
        Palette averages, details;
        add_colours(averages, collect(kept, &KeptBlock::averages));
        add_colours(details, collect(kept, &KeptBlock::details));
        book = make_codebook(volume, averages, details);
    } else {
        const auto lacks = [&kept](const auto& words, auto member) {
            return words.empty() && std::any_of(kept.begin(), kept.end(), [=](const KeptBlock& b) {
                       return !(b.*member).empty();
                   });
        };
        if (lacks(book.averages, &KeptBlock::averages) ||
            lacks(book.details, &KeptBlock::details)) {
            return wrong;  // trained on data without a single average or detail
        }
    }
    return write_code(a, kept, book, codebook, code, threads);
}

}  // namespace octobrick::codec
