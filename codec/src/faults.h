// The first fault of many workers: whatever the thread count, the one of the lowest slab.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>

#include "octobrick/codec/s3dc.h"

namespace octobrick::codec::detail {

template <class Result>
class FirstFaultOf {
  public:
    // Keeps the outcome unless it is ok, or one of a lower slab is known. Slabs are taken in
    // increasing order and each is finished, so the lowest faulty one always gets here.
    void report(std::size_t slab, const Result& outcome) {
        if (outcome.status == decltype(outcome.status)::ok) {
            return;
        }
        const std::lock_guard lock(mutex_);
        if (slab < slab_) {
            slab_ = slab;
            outcome_ = outcome;
        }
    }

    const Result& outcome() const { return outcome_; }

  private:
    std::mutex mutex_;
    std::size_t slab_ = SIZE_MAX;
    Result outcome_;
};

using FirstFault = FirstFaultOf<Outcome>;

// The first voxel of a float volume, in memory order, that is NaN or infinite: not_finite; or ok.
Outcome find_not_finite(const ConstVolume& voxels);

}  // namespace octobrick::codec::detail
