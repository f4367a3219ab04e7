#include "zerobit_format.h"

#include <algorithm>

namespace octobrick::codec::detail {
namespace {

constexpr char kMagic[4] = {'O', 'B', 'Z', 'B'};
constexpr char kCodebookMagic[4] = {'O', 'B', 'Z', 'C'};
constexpr std::uint8_t kVersion = 1;
constexpr std::size_t kFieldNbytes = 4;  // of a sample in the header

// A detail codeword lies like a sample of the signed type.
SampleType detail_type(SampleType type) {
    switch (type) {
        case SampleType::u8: return SampleType::i8;
        case SampleType::u16: return SampleType::i16;
        default: return type;
    }
}

// A sample in a field of 4 bytes; false where the bytes behind it are set, or it is not finite.
bool read_field(SampleType type, const std::uint8_t* from, double& value) {
    value = read_sample(type, from);
    const std::uint8_t* const end = from + kFieldNbytes;
    return std::isfinite(value) &&
           std::all_of(from + sample_nbytes(type), end, [](std::uint8_t b) { return b == 0; });
}

}  // namespace

bool supported(SampleType type, unsigned channels) noexcept {
    return channels == 1 || (channels == 3 && (type == SampleType::u8 || type == SampleType::u16));
}

double read_sample(SampleType type, const void* from) {
    return with_sample_type(
        type, [from](auto zero) { return static_cast<double>(load<decltype(zero)>(from)); });
}

void write_sample(SampleType type, double value, void* to) {
    with_sample_type(type, [=](auto zero) {
        store(to, static_cast<decltype(zero)>(value));
        return 0;
    });
}

std::uint64_t digest(std::span<const std::byte> bytes) {
    std::uint64_t hash = 0xcbf29ce484222325u;
    for (const std::byte b : bytes) {
        hash = (hash ^ static_cast<std::uint8_t>(b)) * 0x100000001b3u;
    }
    return hash;
}

void append_codewords(const Codebook& codebook, std::vector<std::byte>& bytes) {
    const auto append = [&](const std::vector<ZerobitColour>& words, SampleType type) {
        for (const ZerobitColour& word : words) {
            for (unsigned c = 0; c < codebook.channels; ++c) {
                std::byte sample[kFieldNbytes];
                write_sample(type, word[c], sample);
                bytes.insert(bytes.end(), sample, sample + sample_nbytes(type));
            }
        }
    };
    append(codebook.averages, codebook.type);
    append(codebook.details, detail_type(codebook.type));
}

bool read_codewords(std::span<const std::byte> bytes, std::size_t averages, std::size_t details,
                    Codebook& codebook) {
    const std::byte* from = bytes.data();
    bool finite = true;
    const auto read = [&](std::size_t count, SampleType type, std::vector<ZerobitColour>& words) {
        words.assign(count, ZerobitColour{});
        for (ZerobitColour& word : words) {
            for (unsigned c = 0; c < codebook.channels; ++c, from += sample_nbytes(type)) {
                word[c] = read_sample(type, from);
                finite = finite && std::isfinite(word[c]);
            }
        }
    };
    read(averages, codebook.type, codebook.averages);
    read(details, detail_type(codebook.type), codebook.details);
    return finite;
}

std::vector<std::byte> write_codebook(const Codebook& codebook) {
    std::vector<std::byte> bytes(kCodebookHeaderNbytes);
    std::memcpy(bytes.data(), kCodebookMagic, sizeof kCodebookMagic);
    store(&bytes[4], kVersion);
    store(&bytes[5], static_cast<std::uint8_t>(codebook.type));
    store(&bytes[6], static_cast<std::uint8_t>(codebook.channels));
    store(&bytes[8], static_cast<std::uint16_t>(codebook.averages.size()));
    store(&bytes[10], static_cast<std::uint16_t>(codebook.details.size()));
    append_codewords(codebook, bytes);
    return bytes;
}

bool read_codebook(std::span<const std::byte> bytes, Codebook& codebook) {
    if (bytes.size() < kCodebookHeaderNbytes) return false;
    const auto* from = reinterpret_cast<const std::uint8_t*>(bytes.data());
    const std::size_t averages = load<std::uint16_t>(from + 8);
    const std::size_t details = load<std::uint16_t>(from + 10);
    if (std::memcmp(from, kCodebookMagic, sizeof kCodebookMagic) != 0 || from[4] != kVersion ||
        from[5] > static_cast<std::uint8_t>(SampleType::f32) || from[7] != 0 ||
        averages > kCodewords || details > kCodewords || load<std::uint32_t>(from + 12) != 0) {
        return false;
    }
    codebook.type = static_cast<SampleType>(from[5]);
    codebook.channels = from[6];
    const std::size_t unit = codebook.channels * sample_nbytes(codebook.type);
    return supported(codebook.type, codebook.channels) &&
           bytes.size() == kCodebookHeaderNbytes + (averages + details) * unit &&
           read_codewords(bytes.subspan(kCodebookHeaderNbytes), averages, details, codebook);
}

bool lay_out(ZerobitHeader& h) {
    constexpr std::size_t kMost = 0xffffffffu;
    if (std::max({h.shape.z, h.shape.y, h.shape.x, h.blocks_nbytes}) > kMost) return false;
    h.grid = ceil_div(h.shape, kBlock);
    std::size_t voxels, per_block;
    const std::size_t unit = h.channels * sample_nbytes(h.type);
    if (!checked_volume(h.shape, unit, voxels) || !checked_volume(h.grid, 1, h.blocks) ||
        !checked_mul(h.blocks, 1 + sizeof(std::uint32_t), per_block)) {
        return false;
    }
    h.codebook_nbytes = h.shared ? 0 : (h.average_count + h.detail_count) * unit;
    h.thresholds_at = kHeaderNbytes + h.codebook_nbytes;
    h.pointers_at = h.thresholds_at + h.blocks;
    h.blocks_at = h.thresholds_at + per_block;
    h.nbytes = h.blocks_at + h.blocks_nbytes + kTailNbytes;
    return true;
}

void write_header(const ZerobitHeader& h, std::byte* to) {
    std::memset(to, 0, kHeaderNbytes);
    std::memcpy(to, kMagic, sizeof kMagic);
    store(to + 4, kVersion);
    store(to + 5, static_cast<std::uint8_t>(h.type));
    store(to + 6, static_cast<std::uint8_t>(h.channels));
    store(to + 7, static_cast<std::uint8_t>(h.shared));
    store(to + 8, static_cast<std::uint32_t>(h.shape.z));
    store(to + 12, static_cast<std::uint32_t>(h.shape.y));
    store(to + 16, static_cast<std::uint32_t>(h.shape.x));
    store(to + 20, static_cast<std::uint16_t>(h.average_count));
    store(to + 22, static_cast<std::uint16_t>(h.detail_count));
    store(to + 24, h.digest);
    for (unsigned c = 0; c < h.channels; ++c) {
        write_sample(h.type, h.background[c], to + 32 + kFieldNbytes * c);
    }
    write_sample(h.type, h.least, to + 44);
    write_sample(h.type, h.greatest, to + 48);
    store(to + 52, h.threshold_step);
    store(to + 56, static_cast<std::uint32_t>(h.blocks_nbytes));
}

ZerobitOutcome read_header(std::span<const std::byte> code, ZerobitHeader& h) {
    const ZerobitOutcome bad{ZerobitStatus::bad_header, {}, 0, 0};
    if (code.size() < kHeaderNbytes) return bad;
    const auto* from = reinterpret_cast<const std::uint8_t*>(code.data());
    if (std::memcmp(from, kMagic, sizeof kMagic) != 0 || from[4] != kVersion ||
        from[5] > static_cast<std::uint8_t>(SampleType::f32) || from[7] > 1) {
        return bad;
    }
    h.type = static_cast<SampleType>(from[5]);
    h.channels = from[6];
    h.shared = from[7] == 1;
    h.shape = {load<std::uint32_t>(from + 8), load<std::uint32_t>(from + 12),
               load<std::uint32_t>(from + 16)};
    h.average_count = load<std::uint16_t>(from + 20);
    h.detail_count = load<std::uint16_t>(from + 22);
    h.digest = load<std::uint64_t>(from + 24);
    h.threshold_step = load<float>(from + 52);
    h.blocks_nbytes = load<std::uint32_t>(from + 56);
    if (!supported(h.type, h.channels) || h.shape.z == 0 || h.shape.y == 0 || h.shape.x == 0 ||
        h.average_count > kCodewords || h.detail_count > kCodewords ||
        (!h.shared && h.digest != 0) || !std::isfinite(h.threshold_step) ||
        std::signbit(h.threshold_step) || load<std::uint32_t>(from + 60) != 0 || !lay_out(h)) {
        return bad;
    }
    for (unsigned c = 0; c < 3; ++c) {
        const std::uint8_t* const field = from + 32 + kFieldNbytes * c;
        if (!read_field(h.type, field, h.background[c])) return bad;
        if (c >= h.channels && load<std::uint32_t>(field) != 0) return bad;
    }
    if (!read_field(h.type, from + 44, h.least) || !read_field(h.type, from + 48, h.greatest) ||
        h.least > h.greatest) {
        return bad;
    }
    if (code.size() != h.nbytes) {
        return {ZerobitStatus::wrong_nbytes,
                {},
                static_cast<double>(h.nbytes),
                static_cast<double>(code.size())};
    }
    if (load<std::uint64_t>(from + h.nbytes - kTailNbytes) != 0) return bad;
    return {};
}

}  // namespace octobrick::codec::detail
