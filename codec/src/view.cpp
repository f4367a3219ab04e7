#include "rows.h"

namespace octobrick::codec::detail {

bool checked_mul(std::size_t a, std::size_t b, std::size_t& product) noexcept {
    return !__builtin_mul_overflow(a, b, &product) && product <= PTRDIFF_MAX;
}

bool checked_volume(Zyx shape, std::size_t unit, std::size_t& product) noexcept {
    return checked_mul(unit, shape.z, product) && checked_mul(product, shape.y, product) &&
           checked_mul(product, shape.x, product);
}

}  // namespace octobrick::codec::detail
