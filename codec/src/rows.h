// Rows of a strided volume, seen as contiguous arrays.
#pragma once

#include <cstdint>
#include <cstring>
#include <memory>
#include <new>
#include <type_traits>

#include "octobrick/codec/view.h"
#include "simd.h"

namespace octobrick::codec::detail {

// a * b, false where it exceeds PTRDIFF_MAX.
bool checked_mul(std::size_t a, std::size_t b, std::size_t& product) noexcept;

// unit * z * y * x, false where it exceeds PTRDIFF_MAX.
bool checked_volume(Zyx shape, std::size_t unit, std::size_t& product) noexcept;

// n objects of a trivial type, aligned to a cache line and zeroed.
template <class T>
class Array {
  public:
    explicit Array(std::size_t n) : data_(new(std::align_val_t{64}) T[n]()) {}
    T* data() const { return data_.get(); }
    T& operator[](std::size_t i) const { return data_.get()[i]; }

  private:
    struct Free {
        void operator()(T* p) const { ::operator delete[](p, std::align_val_t{64}); }
    };
    std::unique_ptr<T[], Free> data_;
};

// Whether every row can be used where it lies: samples adjacent in x, and aligned.
template <class T, class View>
bool rows_in_place(const View& v) {
    const auto misaligned = reinterpret_cast<std::uintptr_t>(v.origin) |
                            static_cast<std::uintptr_t>(v.strides.z) |
                            static_cast<std::uintptr_t>(v.strides.y);
    return (v.strides.x == sizeof(T) || v.shape.x == 1) && misaligned % alignof(T) == 0;
}

// The address of voxel (z, y, 0).
template <class View>
auto row_origin(const View& v, std::size_t z, std::size_t y) {
    return v.origin + static_cast<std::ptrdiff_t>(z) * v.strides.z +
           static_cast<std::ptrdiff_t>(y) * v.strides.y;
}

// Reads rows: in place where possible, else each through a copy, so that no more than one row
// of a strided volume is ever copied.
template <class T>
class RowReader {
  public:
    explicit RowReader(const ConstVolume& v)
        : v_(v), in_place_(rows_in_place<T>(v)), copy_(in_place_ ? 0 : v.shape.x) {}

    // Row (z, y), valid until the next call.
    const T* row(std::size_t z, std::size_t y) const {
        const std::byte* from = row_origin(v_, z, y);
        if (in_place_) {
            return reinterpret_cast<const T*>(from);
        }
        for (std::size_t x = 0; x < v_.shape.x; ++x, from += v_.strides.x) {
            std::memcpy(&copy_[x], from, sizeof(T));
        }
        return copy_.data();
    }

  private:
    ConstVolume v_;
    bool in_place_;
    Array<T> copy_;
};

// Writes rows, the mirror of RowReader: fill row(), then commit() it.
template <class T>
class RowWriter {
  public:
    explicit RowWriter(const Volume& v)
        : v_(v), in_place_(rows_in_place<T>(v)), copy_(in_place_ ? 0 : v.shape.x) {}

    T* row(std::size_t z, std::size_t y) const {
        return in_place_ ? reinterpret_cast<T*>(row_origin(v_, z, y)) : copy_.data();
    }

    void commit(std::size_t z, std::size_t y) const {
        if (in_place_) {
            return;
        }
        std::byte* to = row_origin(v_, z, y);
        for (std::size_t x = 0; x < v_.shape.x; ++x, to += v_.strides.x) {
            std::memcpy(to, &copy_[x], sizeof(T));
        }
    }

  private:
    Volume v_;
    bool in_place_;
    Array<T> copy_;
};

// The rows of one line of blocks along x, all at once: in place where possible, else in a copy of
// the line. `View` is ConstVolume, to be read, or Volume, to be written.
template <class T, class View>
class SlabRows {
    static constexpr bool kWrites = std::is_same_v<View, Volume>;

  public:
    using Sample = std::conditional_t<kWrites, T, const T>;

    // No slab has more rows than `block` in z and y.
    SlabRows(const View& v, Zyx block)
        : v_(v),
          in_place_(rows_in_place<T>(v)),
          copy_(in_place_ ? 0 : block.z * block.y * v.shape.x) {}

    // Goes to the rows [begin.z, end.z) × [begin.y, end.y).
    void open(Zyx begin, Zyx end) {
        begin_ = begin;
        end_ = end;
        if constexpr (!kWrites)
            each_copied([](T& to, const std::byte* from) { std::memcpy(&to, from, sizeof(T)); });
    }

    // Row (z, y), counted from `begin`.
    Sample* row(std::size_t z, std::size_t y) const {
        return in_place_ ? reinterpret_cast<Sample*>(row_origin(v_, begin_.z + z, begin_.y + y))
                         : copied_row(z, y);
    }

    // Samples from one row to the next, and from the last of a z to the first of the next.
    std::ptrdiff_t y_stride() const {
        return in_place_ ? v_.strides.y / static_cast<std::ptrdiff_t>(sizeof(T))
                         : static_cast<std::ptrdiff_t>(v_.shape.x);
    }
    std::ptrdiff_t z_stride() const {
        return in_place_ ? v_.strides.z / static_cast<std::ptrdiff_t>(sizeof(T))
                         : static_cast<std::ptrdiff_t>((end_.y - begin_.y) * v_.shape.x);
    }

    // Ends the writing of the open rows.
    void commit() {
        each_copied([](const T& from, std::byte* to) { std::memcpy(to, &from, sizeof(T)); });
    }

  private:
    T* copied_row(std::size_t z, std::size_t y) const {
        return copy_.data() + (z * (end_.y - begin_.y) + y) * v_.shape.x;
    }

    template <class F>
    void each_copied(const F& f) {
        if (in_place_) return;
        for (std::size_t z = 0; z < end_.z - begin_.z; ++z) {
            for (std::size_t y = 0; y < end_.y - begin_.y; ++y) {
                auto* at = row_origin(v_, begin_.z + z, begin_.y + y);
                T* row = copied_row(z, y);
                for (std::size_t x = 0; x < v_.shape.x; ++x, at += v_.strides.x) f(row[x], at);
            }
        }
    }

    View v_;
    bool in_place_;
    Array<T> copy_;
    Zyx begin_, end_;
};

// Calls f(T{}) with the sample type as a C++ type.
template <class F>
auto with_sample_type(SampleType type, const F& f) {
    switch (type) {
        case SampleType::u8: return f(std::uint8_t{});
        case SampleType::i8: return f(std::int8_t{});
        case SampleType::u16: return f(std::uint16_t{});
        case SampleType::i16: return f(std::int16_t{});
        case SampleType::f32: break;
    }
    return f(float{});
}

}  // namespace octobrick::codec::detail
