// Contiguous numpy arrays, seen as the codec sees them.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "octobrick/codec/view.h"

// A contiguous volume of any sample type.
using AnyVolume =
    nanobind::ndarray<nanobind::ro, nanobind::ndim<3>, nanobind::c_contig, nanobind::device::cpu>;

inline void require(bool holds, const char* message) {
    if (!holds) {
        throw nanobind::value_error(message);
    }
}

inline octobrick::codec::SampleType sample_type_of(nanobind::dlpack::dtype type) {
    using octobrick::codec::SampleType;
    if (type == nanobind::dtype<std::uint8_t>()) return SampleType::u8;
    if (type == nanobind::dtype<std::int8_t>()) return SampleType::i8;
    if (type == nanobind::dtype<std::uint16_t>()) return SampleType::u16;
    if (type == nanobind::dtype<std::int16_t>()) return SampleType::i16;
    if (type == nanobind::dtype<float>()) return SampleType::f32;
    throw nanobind::type_error("expected native uint8, int8, uint16, int16 or float32");
}

inline octobrick::codec::ConstVolume volume_of(const AnyVolume& array) {
    require(array.size() > 0, "expected at least one voxel");
    octobrick::codec::ConstVolume v;
    v.origin = static_cast<const std::byte*>(array.data());
    v.type = sample_type_of(array.dtype());
    v.shape = {array.shape(0), array.shape(1), array.shape(2)};
    const auto nbytes = static_cast<std::ptrdiff_t>(octobrick::codec::sample_nbytes(v.type));
    v.strides = {array.stride(0) * nbytes, array.stride(1) * nbytes, array.stride(2) * nbytes};
    return v;
}
