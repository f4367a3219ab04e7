// S3Dc with an index width for each block: from constant blocks to uncoded ones, in one code.
//
// docs/spec/s3dc-variable.md gives the bytes. A block is found in constant time, so a GPU can keep
// this code compressed as well. Widths are chosen for a bound of the error, or for a size. Blocks
// may be coded as differences to a prediction: a volume that the decoder has too, such as the
// upsampled parent level, or the time step before.
//
// The promises at the top of s3dc.h hold here too, but for scratch memory: for each thread up to 32
// bytes per voxel of one block, and a line of blocks along x where the volume's rows are not
// contiguous; for a budget or a slope, the encoder takes 250 bytes a block.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "octobrick/codec/s3dc.h"
#include "octobrick/codec/view.h"

namespace octobrick::codec {

// How the width of every block is chosen.
struct WidthRule {
    enum class Kind : std::uint8_t {
        same,    // `value` bits for all blocks, 0 to 8
        bound,   // the least width with which no voxel is off by more than `value` >= 0
        budget,  // the least squared error with `value` bits per voxel, all parts of the code
                 // counted
        slope,   // every bit is spent that lowers the squared error by `value` > 0 or more
    };
    Kind kind = Kind::same;
    double value = 4;
};

// What an encoder needs to know; a decoder needs the block.
struct VariableS3dc {
    Zyx block;
    WidthRule widths;
    // Take end points that lower the squared error, rather than least and greatest voxel. A bound
    // has its own way, and ignores this.
    bool fitted = true;
};

// Where the parts of a code lie, which all but its payload follow from shape, type and block.
struct VariableLayout {
    Zyx block;                     // no larger than the volume
    Zyx grid;                      // blocks per axis
    std::size_t blocks = 0;        // in all
    std::size_t unit_nbytes = 0;   // of the payload, for each bit of a block's width
    std::size_t groups_begin = 0;  // end points lie before it
    std::size_t flags_begin = 0;   // as payload_begin where there is no prediction
    std::size_t payload_begin = 0;
};

// Computes the layout; any arguments are safe. Fails with bad_block, empty_shape or too_large.
Status make_variable_layout(Zyx block, SampleType type, Zyx shape, bool predicted,
                            VariableLayout& layout) noexcept;

// Writes the code of `voxels`. `prediction` has its type and shape, or is null. Fails as
// make_variable_layout does, or with bad_widths (a rule's value out of its range), budget_too_small
// (`first` bits per voxel are asked for, `second` are needed before any voxel has one),
// wrong_prediction, or not_finite (also of the prediction).
Outcome encode_variable(const VariableS3dc& codec, const ConstVolume& voxels,
                        const ConstVolume* prediction, std::vector<std::byte>& code,
                        Execution execution = {});

// Reads voxels; whether there is a prediction must be as it was for the encoder. Safe for hostile
// bytes. Fails as make_variable_layout does, or with wrong_prediction, not_finite (of the
// prediction), wrong_nbytes (`first` bytes would be right, `second` are given), bad_end_points,
// bad_groups (`at` is the first block of the group) or bad_raw (a voxel of the uncoded block `at`
// is not within its end points); after these the voxels are unspecified.
Outcome decode_variable(Zyx block, std::span<const std::byte> code, const ConstVolume* prediction,
                        const Volume& voxels, Execution execution = {});

// Finds one slope for many volumes, so that bits go where they save most in all of them together.
class SlopeFinder {
  public:
    // The codec's rule does not matter.
    SlopeFinder(const VariableS3dc& codec, SampleType type);
    ~SlopeFinder();
    // Looks at a volume; keeps 16,384 sums, whatever the number of volumes. Fails as
    // encode_variable does.
    Outcome add(const ConstVolume& voxels, const ConstVolume* prediction, Execution execution = {});
    // The least slope, within 1/64, at which the volumes together need no more than so many bits a
    // voxel. Infinite where that is too few for any.
    double slope(double bits_per_voxel) const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace octobrick::codec
