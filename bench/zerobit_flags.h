// The coding that zerobit came after, to compare with: 64 flags for every cell.
//
// Bajaj, Ihm, Park 2001 call it OLD: a cell that is not null has eight bytes of flags, which say of
// its 64 coefficients which are not null, and two bytes that say where the indices of those begin.
// All else is as in docs/spec/zerobit.md: the same coefficients, codebook, unit blocks and null
// cells. Its bytes exist in memory only, made from a code, and it decodes to the same voxels.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "octobrick/codec/zerobit.h"

namespace octobrick::bench {

// How the flags before one are counted: by a table of 65,536 entries, as the paper does, or by the
// processor's instruction.
enum class Counting { table, instruction };

class FlagsReader {
  public:
    virtual ~FlagsReader() = default;
    virtual std::size_t nbytes() const = 0;
    // As those of codec::ZerobitReader.
    virtual void voxels(std::span<const codec::Zyx> at, std::byte* out) const = 0;
    virtual void cells(std::span<const codec::Zyx> at, std::byte* out) const = 0;
    void cell(codec::Zyx at, std::byte* out) const { cells({&at, 1}, out); }
};

// `code` must be sound, have its own codebook and whole numbers as samples, else the result is
// null. So it is where the processor cannot count bits.
std::unique_ptr<FlagsReader> recode_with_flags(std::span<const std::byte> code,
                                               const codec::ZerobitHeader& header,
                                               Counting counting);

}  // namespace octobrick::bench
