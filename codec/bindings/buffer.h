// Memory of a Python object, seen as bytes or as a strided volume.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <span>
#include <string_view>

#include "octobrick/codec/view.h"

// A Python buffer for as long as this lives.
class Buffer {
  public:
    explicit Buffer(nanobind::handle object, int flags = PyBUF_SIMPLE) {
        if (PyObject_GetBuffer(object.ptr(), &view_, flags) != 0) {
            throw nanobind::python_error();
        }
    }
    ~Buffer() { PyBuffer_Release(&view_); }
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;

    std::byte* data() const { return static_cast<std::byte*>(view_.buf); }
    std::size_t size() const { return static_cast<std::size_t>(view_.len); }
    std::span<const std::byte> bytes() const { return {data(), size()}; }

    // Throws unless it has exactly this many bytes: the last guard between Python and memory.
    void require_nbytes(std::size_t nbytes) const {
        if (size() != nbytes) {
            throw nanobind::value_error("a buffer has another size than its shape");
        }
    }

    // The buffer as a volume; `View` is Volume or ConstVolume.
    template <class View>
    View volume() const {
        if (view_.ndim != 3) {
            throw nanobind::value_error("expected three axes (z, y, x)");
        }
        View v;
        v.origin = data();
        v.type = sample_type();
        v.shape = {static_cast<std::size_t>(view_.shape[0]),
                   static_cast<std::size_t>(view_.shape[1]),
                   static_cast<std::size_t>(view_.shape[2])};
        v.strides = {view_.strides[0], view_.strides[1], view_.strides[2]};
        return v;
    }

  private:
    octobrick::codec::SampleType sample_type() const {
        using octobrick::codec::SampleType;
        // Before the letter a prefix may tell the byte order, '^' or '=' where samples are not
        // aligned. '>' is none of ours.
        const std::string_view format = view_.format != nullptr ? view_.format : "B";
        const bool prefixed = format.size() == 2 &&
                              std::string_view("@=<^").find(format[0]) != std::string_view::npos;
        if (format.size() == (prefixed ? 2 : 1)) {
            switch (format.back()) {
                case 'B': return SampleType::u8;
                case 'b': return SampleType::i8;
                case 'H': return SampleType::u16;
                case 'h': return SampleType::i16;
                case 'f': return SampleType::f32;
            }
        }
        throw nanobind::type_error("expected native uint8, int8, uint16, int16 or float32");
    }

    Py_buffer view_{};
};
