// Whether a code with a width per block is one: what all its readers refuse.
#pragma once

#include <cstddef>
#include <span>

#include "s3dc_variable_format.h"

namespace octobrick::codec::detail {

// Finds in a code without a prediction all that `decode_variable` would refuse, without decoding
// it, and says the same of it. The layout must be that of this type and shape.
Outcome check_variable_code(const VariableLayout& layout, SampleType type, Zyx shape,
                            std::span<const std::byte> code);

}  // namespace octobrick::codec::detail
