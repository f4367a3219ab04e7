// Central differences along one axis.
#pragma once

#include <cstddef>

#include "simd.h"

namespace octobrick::codec::detail {

// The two neighbours of position i on an axis of n, and what their difference is multiplied by.
struct Stencil {
    std::size_t below, above;
    double scale;
    Stencil(std::size_t i, std::size_t n, double spacing)
        : below(i > 0 ? i - 1 : 0),
          above(i + 1 < n ? i + 1 : i),
          scale((above - below == 2 ? 0.5 : 1.0) / spacing) {}
};

template <class T>
OCTOBRICK_INLINE double difference(T above, T below, double scale) {
    return (static_cast<double>(above) - static_cast<double>(below)) * scale;
}

}  // namespace octobrick::codec::detail
