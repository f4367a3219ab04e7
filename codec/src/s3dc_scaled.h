// S3Dc codes with trained scales, behind encode() and decode() of s3dc.h.
#pragma once

#include <cstdint>

#include "octobrick/codec/s3dc.h"

namespace octobrick::codec::detail {

// `code` has layout.nbytes bytes.
Outcome encode_scaled(const S3dc& codec, const ConstVolume& voxels, const Layout& layout,
                      std::uint8_t* code, Execution execution);
Outcome decode_scaled(const S3dc& codec, const std::uint8_t* code, const Layout& layout,
                      const Volume& voxels, Execution execution);

}  // namespace octobrick::codec::detail
