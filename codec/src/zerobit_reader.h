// Makes the reader for a sample type and a number of channels.
#pragma once

#include <memory>
#include <span>

#include "octobrick/codec/zerobit.h"
#include "zerobit_format.h"

namespace octobrick::codec::detail {

// The header must be one that read_header accepts, and the codebook be its own.
std::unique_ptr<ZerobitReader> make_reader(std::span<const std::byte> code,
                                           const ZerobitHeader& header, const Codebook& book);

}  // namespace octobrick::codec::detail
