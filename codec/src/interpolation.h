// Samples at many points, from any source of voxels. The source is a policy, `Access`:
//
//   using One = …, Eight = …;      where a voxel, or eight, lie in memory
//   One place_one(int x, int y, int z) const;
//   void place_eight(const IntFour& low, Eight&) const;
//       of a voxel (x, y, z) and the next ones on each axis; where there is none, the voxel itself
//   void prefetch(const One&) const;
//   void prefetch(const Eight&) const;
//       OCTOBRICK_INLINE: gcc drops calls of functions that do nothing but prefetch
//   void look_up(One&) const;
//   void look_up(Eight&) const;
//       what must be read to know where to read, of memory that was fetched ahead meanwhile
//   double one(const One&) const;  the decoded voxel
//   void eight(const Eight&, Corners&) const;
//       all eight, fetching once what they share
//   const IntFour& step() const;   1 on each axis longer than 1, else 0
//
// S3dcAccess and VariableAccess are such sources; a code with another layout of indices needs
// another, and nothing else.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>

#include "four.h"
#include "sample_positions.h"
#include "simd.h"

namespace octobrick::codec::detail {

// Eight voxels, at x and at x + 1. Lanes are (y, z), (y, z + 1), (y + 1, z), (y + 1, z + 1).
struct Corners {
    DoubleFour low, high;
};

// The sample at a distance `weight` from a to b. Exact at both ends: at the centre of a voxel it is
// the voxel itself.
template <class V>
OCTOBRICK_INLINE void between(const V& a, const V& b, double weight, V& sample) {
    sample = a * (1 - weight) + b * weight;
}

// Along x, then y, then z.
OCTOBRICK_INLINE double interpolate(const Corners& c, const Position& at) {
    DoubleFour along_x;
    DoubleTwo along_y;
    double sample;
    between(c.low, c.high, at.weight[0], along_x);
    between(DoubleTwo{along_x[0], along_x[1]}, DoubleTwo{along_x[2], along_x[3]}, at.weight[1],
            along_y);
    between(along_y[0], along_y[1], at.weight[2], sample);
    return sample;
}

// ---- The three ways of sampling, each as a policy ----

template <class Access>
struct NearestOf {
    struct Place {
        typename Access::One voxel;
        double weights;  // 0, or NaN
    };
    OCTOBRICK_INLINE static void locate(const Access& access, const SampleAxes& axes,
                                        const DoubleFour& point, Place& place) {
        Position at;
        axes.nearest(point, at);
        place.weights = at.weight[0] + at.weight[1] + at.weight[2];
        place.voxel = access.place_one(at.low[0], at.low[1], at.low[2]);
        access.prefetch(place.voxel);
    }
    OCTOBRICK_INLINE static void look_up(const Access& access, Place& place) {
        access.look_up(place.voxel);
    }
    OCTOBRICK_INLINE static double value(const Access& access, const Place& place) {
        const double voxel = access.one(place.voxel);
        return place.weights == 0 ? voxel : place.weights;
    }
};

template <class Access>
struct TrilinearOf {
    using Place = Position;
    // Fetches nothing ahead: what eight voxels have in common is not looked at.
    OCTOBRICK_INLINE static void locate(const Access&, const SampleAxes& axes,
                                        const DoubleFour& point, Place& at) {
        axes.between(point, at);
    }
    OCTOBRICK_INLINE static void look_up(const Access&, Place&) {}
    OCTOBRICK_INLINE static double value(const Access& access, const Place& at) {
        const int x = at.low[0], y = at.low[1], z = at.low[2];
        const int next_x = x + access.step()[0], next_y = y + access.step()[1],
                  next_z = z + access.step()[2];
        const auto voxel = [&](int vx, int vy, int vz) {
            auto place = access.place_one(vx, vy, vz);
            access.look_up(place);
            return access.one(place);
        };
        const Corners corners = {
            {voxel(x, y, z), voxel(x, y, next_z), voxel(x, next_y, z), voxel(x, next_y, next_z)},
            {voxel(next_x, y, z), voxel(next_x, y, next_z), voxel(next_x, next_y, z),
             voxel(next_x, next_y, next_z)}};
        return interpolate(corners, at);
    }
};

template <class Access>
struct TrilinearSharedOf {
    struct Place {
        typename Access::Eight voxels;
        Position at;
    };
    OCTOBRICK_INLINE static void locate(const Access& access, const SampleAxes& axes,
                                        const DoubleFour& point, Place& place) {
        axes.between(point, place.at);
        access.place_eight(place.at.low, place.voxels);
        access.prefetch(place.voxels);
    }
    OCTOBRICK_INLINE static void look_up(const Access& access, Place& place) {
        access.look_up(place.voxels);
    }
    OCTOBRICK_INLINE static double value(const Access& access, const Place& place) {
        Corners corners = {};
        access.eight(place.voxels, corners);
        return interpolate(corners, place.at);
    }
};

// ---- Many points ----

// So many points are located first, then looked up, then sampled: while the memory of one is on its
// way, others are worked on. More would not find free buffers for lines that are being fetched.
inline constexpr std::size_t kTogether = 32;

// n points of either width, so that what follows is compiled once.
template <class P>
OCTOBRICK_INLINE void load_points(const P* xyz, std::size_t n, DoubleFour* points) {
    for (std::size_t k = 0; k < n; ++k) {
        const P* p = xyz + 3 * k;
        using Vector [[gnu::vector_size(4 * sizeof(P))]] = P;
        convert(Vector{p[0], p[1], p[2], 0}, points[k]);
    }
}

// Calls put(k, sample) for each of n points, in order; n <= kTogether. Each is moved first.
template <template <class> class How, class Access, class F>
OCTOBRICK_INLINE void sample_some(const Access& access, const SampleAxes& axes,
                                  const DoubleFour* points, std::size_t n, const DoubleFour& moved,
                                  const F& put) {
    using Method = How<Access>;
    typename Method::Place places[kTogether];
    for (std::size_t k = 0; k < n; ++k) {
        Method::locate(access, axes, points[k] + moved, places[k]);
    }
    for (std::size_t k = 0; k < n; ++k) Method::look_up(access, places[k]);
    for (std::size_t k = 0; k < n; ++k) put(k, Method::value(access, places[k]));
}

// The samples at n <= kTogether points.
template <template <class> class How, class Access>
OCTOBRICK_INLINE void sample_points(const Access& access, const SampleAxes& axes,
                                    const DoubleFour* points, std::size_t n, float* out) {
    const DoubleFour stay = {};
    sample_some<How>(access, axes, points, n, stay,
                     [out](std::size_t k, double sample) { out[k] = static_cast<float>(sample); });
}

}  // namespace octobrick::codec::detail
