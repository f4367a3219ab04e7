// The Haar transform of 2^3 values, and what it works on.
//
//   coefficient[j] = 1/8 sum v[z][y][x] (-1)^(x j4 + y j2 + z j1)      v = sum of coefficients,
//   same signs
//
// where j4, j2 and j1 are the bits of j: the letters of the paper's c_lll to c_hhh, for x, y and z.
// Value (z, y, x) has the number 4z + 2y + x.
#pragma once

#include <cstddef>
#include <cstdint>

namespace octobrick::codec::detail {

// A colour in the decoder's arithmetic. Three channels take four lanes: one register.
template <class A, unsigned Channels>
struct Lanes {
    using Scalar = A;
    static constexpr unsigned kLanes = Channels == 1 ? 1 : 4;
    A at[kLanes] = {};

    friend Lanes operator+(Lanes a, const Lanes& b) {
        for (unsigned i = 0; i < kLanes; ++i) a.at[i] += b.at[i];
        return a;
    }
    friend Lanes operator-(Lanes a, const Lanes& b) {
        for (unsigned i = 0; i < kLanes; ++i) a.at[i] -= b.at[i];
        return a;
    }
};

// The coordinates wanted along one axis: [0, 2), or one of them.
struct Part {
    unsigned begin = 0, end = 2;
    static Part one(unsigned at) { return {at, at + 1}; }
};

template <class V>
V add_or_subtract(bool subtract, const V& a, const V& b) {
    return subtract ? a - b : a + b;
}

// Values of the wanted part from coefficients: pairs along z, then y, then x, each sum once.
template <class V>
inline void haar_inverse(const V (&coefficient)[8], Part z, Part y, Part x, V (&value)[8]) {
    V pair[2][4], quad[2][2][2];
    for (unsigned iz = z.begin; iz < z.end; ++iz) {
        for (unsigned k = 0; k < 4; ++k) {
            pair[iz][k] = add_or_subtract(iz, coefficient[2 * k], coefficient[2 * k + 1]);
        }
        for (unsigned iy = y.begin; iy < y.end; ++iy) {
            for (unsigned k = 0; k < 2; ++k) {
                quad[iz][iy][k] = add_or_subtract(iy, pair[iz][2 * k], pair[iz][2 * k + 1]);
            }
            for (unsigned ix = x.begin; ix < x.end; ++ix) {
                value[4 * iz + 2 * iy + ix] = add_or_subtract(ix, quad[iz][iy][0], quad[iz][iy][1]);
            }
        }
    }
}

// Eight times the coefficients of eight values: the mirror of the above, x first.
inline void haar_forward_sums(const double (&value)[8], double (&sum)[8]) {
    double quad[2][2][2], pair[2][4];
    for (unsigned iz = 0; iz < 2; ++iz) {
        for (unsigned iy = 0; iy < 2; ++iy) {
            const double a = value[4 * iz + 2 * iy], b = value[4 * iz + 2 * iy + 1];
            quad[iz][iy][0] = a + b;
            quad[iz][iy][1] = a - b;
        }
        for (unsigned k = 0; k < 2; ++k) {
            pair[iz][2 * k] = quad[iz][0][k] + quad[iz][1][k];
            pair[iz][2 * k + 1] = quad[iz][0][k] - quad[iz][1][k];
        }
    }
    for (unsigned k = 0; k < 4; ++k) {
        sum[2 * k] = pair[0][k] + pair[1][k];
        sum[2 * k + 1] = pair[0][k] - pair[1][k];
    }
}

}  // namespace octobrick::codec::detail
