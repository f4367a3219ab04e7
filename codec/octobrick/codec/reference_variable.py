"""S3Dc with a width per block, and with trained scales, in plain numpy: the oracle for other code.

Every formula stands here as docs/spec/s3dc-variable.md and docs/spec/s3dc.md have it. Encoders may
choose widths and end points as they like; here they are chosen for a bound of the error, and where
all blocks have one width. Only well-formed arguments are expected.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from octobrick.codec import reference
from octobrick.codec.reference import Array, Zyx, blocks

RAW = 15
MOST_WIDTH = 14
SCALES = 8
SCALE_TOP = 65535


@dataclass(frozen=True)
class Block:
    """What an encoder decides for a block: `first` and `last` are end points of its values."""

    width: int
    predicted: bool
    first: Any
    last: Any


# ---- Decoding --------------------------------------------------------------------------------


def decode(
    data: bytes, shape: Zyx, dtype: DTypeLike, block: Zyx, prediction: Array | None = None
) -> Array:
    """The voxels of a well-formed code with a width per block."""
    sample = np.dtype(dtype)
    block = _no_larger(block, shape)
    places = list(blocks(shape, block))
    unit = 4 * -(-int(np.prod(block)) // 32)
    ends_nbytes = 2 * sample.itemsize * len(places)
    groups_begin = -(-ends_nbytes // 4) * 4
    group_count = -(-len(places) // 8)
    flags_begin = groups_begin + 8 * group_count
    payload_begin = flags_begin + (0 if prediction is None else -(-group_count // 4) * 4)
    out = np.empty(shape, sample)
    for number, (_, voxels) in enumerate(places):
        group, place = divmod(number, 8)
        first_unit, widths = np.frombuffer(data, "<u4", 2, groups_begin + 8 * group).tolist()
        width = widths >> 4 * place & 15
        before = [widths >> 4 * k & 15 for k in range(place)]
        units = first_unit + sum(8 * sample.itemsize if w == RAW else w for w in before)
        predicted = prediction is not None and bool(data[flags_begin + group] >> place & 1)
        payload = data[payload_begin + units * unit :]
        if width == RAW:
            count = int(np.prod(block))
            whole = np.frombuffer(payload, sample.newbyteorder("<"), count).reshape(block)
            out[voxels] = _cut(whole, out[voxels].shape)
            continue
        kind = _difference_dtype(sample) if predicted else sample
        ends = np.frombuffer(data, kind.newbyteorder("<"), 2, 2 * sample.itemsize * number)
        low, high = ends.astype(kind)
        indices = _cut(unpack_block(payload, block, width), out[voxels].shape)
        values = dequantise(indices, low, high, width)
        if predicted:
            assert prediction is not None
            values = add_prediction(prediction[voxels], values)
        out[voxels] = values
    return out


def unpack_block(payload: bytes, block: Zyx, width: int) -> Array:
    """The indices of a whole block: of more than 8 bits, low bytes first, then high bits."""
    count = -(-int(np.prod(block)) // 32) * 32
    if width == 0:
        return np.zeros(block, np.int64)
    low = _unpack(payload, count, min(width, 8))
    if width > 8:
        low |= _unpack(payload[count:], count, width - 8) << 8
    return low[: int(np.prod(block))].reshape(block)


def dequantise(indices: Array, low: Any, high: Any, width: int) -> Array:
    """Values of indices of any width; a single value where there are no bits."""
    if width == 0:
        return np.full(indices.shape, low)
    return reference.dequantise(indices, low, high, width)


def add_prediction(prediction: Array, difference: Array) -> Array:
    """Voxels from their prediction, within the sample type."""
    if prediction.dtype.kind == "f":
        total = prediction.astype(np.float64) + difference.astype(np.float64)
        most = np.finfo(np.float32).max
        return np.clip(total, -np.float64(most), np.float64(most)).astype(np.float32)
    info = np.iinfo(prediction.dtype)
    exact = prediction.astype(np.int64) + difference.astype(np.int64)
    return np.clip(exact, info.min, info.max).astype(prediction.dtype)


# ---- Encoding --------------------------------------------------------------------------------


def encode_bound(
    array: Array, block: Zyx, max_error: float, prediction: Array | None = None
) -> bytes:
    """The code with the fewest bits in every block that keep a bound."""

    def decide(values: Array, expected: Array | None) -> Block:
        best = _least_width(values, None, max_error)
        difference = _difference(values, expected)
        if difference is not None and _reach(difference) < _reach(values):
            assert expected is not None
            other = _least_width(values, expected, max_error)
            best = other if other.width < best.width else best
        return best

    return _encode(array, block, prediction, decide)


def encode_same(array: Array, block: Zyx, width: int, prediction: Array | None = None) -> bytes:
    """The code with one width for all blocks, whose end points are least and greatest."""

    def decide(values: Array, expected: Array | None) -> Block:
        difference = _difference(values, expected)
        if difference is not None and _reach(difference) < _reach(values):
            return Block(width, True, difference.min(), difference.max())
        return Block(width, False, values.min(), values.max())

    return _encode(array, block, prediction, decide)


def pack_block(indices: Array, block: Zyx, width: int) -> bytes:
    """The mirror of `unpack_block`; `indices` may be those of a cut block."""
    count = -(-int(np.prod(block)) // 32) * 32
    whole = np.zeros(block, np.int64)
    whole[tuple(slice(n) for n in indices.shape)] = indices
    padded = np.zeros(count, np.int64)
    padded[: whole.size] = whole.ravel()
    if width <= 8:
        return _pack(padded, width)
    return _pack(padded & 255, 8) + _pack(padded >> 8, width - 8)


def quantise(values: Array, low: Any, high: Any, width: int) -> Array:
    """Indices of values, which may lie outside of the end points, for any width."""
    levels = 2**width - 1
    if values.dtype.kind == "f":
        span = np.float64(high) - np.float64(low)
        inside = np.clip(values.astype(np.float64) - np.float64(low), 0, span)
        nearest: Array = np.floor(inside / (span or 1) * levels + 0.5)
        return nearest.astype(np.int64)
    reach = int(high) - int(low)
    inside = np.clip(values.astype(np.int64) - int(low), 0, reach)
    indices: Array = (inside * levels + reach // 2) // (reach or 1)
    return indices


def _encode(array: Array, block: Zyx, prediction: Array | None, decide: Any) -> bytes:
    sample, block = array.dtype, _no_larger(block, array.shape)
    ends, widths, flags, payloads = b"", [], [], []
    for _, voxels in blocks(array.shape, block):
        values = array[voxels]
        expected = None if prediction is None else prediction[voxels]
        choice = decide(values, expected)
        kind = _difference_dtype(sample) if choice.predicted else sample
        pair = np.array([choice.first, choice.last], kind)
        ends += (pair + kind.type(0)).astype(kind.newbyteorder("<")).tobytes()
        widths.append(choice.width)
        flags.append(choice.predicted)
        if choice.width == RAW:
            whole = np.zeros(block, sample.newbyteorder("<"))
            whole[tuple(slice(n) for n in values.shape)] = values
            room = 8 * sample.itemsize * 4 * -(-whole.size // 32)
            payloads.append(whole.tobytes().ljust(room, b"\0"))
        elif choice.width > 0:
            coded = _difference(values, expected) if choice.predicted else values
            assert coded is not None
            indices = quantise(coded, pair[0], pair[1], choice.width)
            payloads.append(pack_block(indices, block, choice.width))
        else:
            payloads.append(b"")
    ends = ends.ljust(-(-len(ends) // 4) * 4, b"\0")
    unit = 4 * -(-int(np.prod(block)) // 32)
    return (
        ends + _tables(widths, flags, payloads, unit, prediction is not None) + b"".join(payloads)
    )


def _tables(
    widths: list[int], flags: list[bool], payloads: list[bytes], unit: int, predicted: bool
) -> bytes:
    groups, marks, units = b"", b"", 0
    for begin in range(0, len(widths), 8):
        here = range(begin, min(begin + 8, len(widths)))
        nibbles = sum(widths[i] << 4 * (i - begin) for i in here)
        groups += np.array([units, nibbles], "<u4").tobytes()
        marks += bytes([sum(flags[i] << (i - begin) for i in here)])
        units += sum(len(payloads[i]) for i in here) // unit
    return groups + (marks.ljust(-(-len(marks) // 4) * 4, b"\0") if predicted else b"")


def _least_width(values: Array, expected: Array | None, max_error: float) -> Block:
    """Widths are tried from the first on that can do; end points are those of `even_ends`."""
    coded = values if expected is None else _difference(values, expected)
    assert coded is not None
    rounding = 0.5 if values.dtype.kind != "f" else 0.0
    most = 8 if values.dtype.itemsize == 1 else MOST_WIDTH
    width = 0
    while width < most and _reach(coded) / 2 ** (width + 1) > max_error + rounding:
        width += 1
    for tried in range(width, most + 1):
        first, last = even_ends(coded, tried)
        decoded = dequantise(quantise(coded, first, last, tried), first, last, tried)
        if expected is not None:
            decoded = add_prediction(expected, decoded)
        off = np.abs(decoded.astype(np.float64) - values.astype(np.float64)).max()
        if off <= max_error:
            return Block(tried, expected is not None, first, last)
    return Block(RAW, False, values.min(), values.max())


def even_ends(values: Array, width: int) -> tuple[Any, Any]:
    """End points half a step inside of the range: evenly spread values are least far off then."""
    low, high, kind = values.min(), values.max(), values.dtype.type
    if values.dtype.kind != "f":
        reach = int(high) - int(low)
        if reach < 2**width:
            return low, high
        margin = (reach + 1) // (2 * 2**width)
        return kind(int(low) + margin), kind(
            int(low) + margin if width == 0 else int(high) - margin
        )
    if low == high:
        return low + kind(0), high + kind(0)
    span = (np.float64(high) - np.float64(low)) / 65535
    margin_part = np.float32(65535) / np.float32(2 ** (width + 1))
    ends = [margin_part, margin_part if width == 0 else np.float32(65535) - margin_part]
    first, last = (np.float32(np.float64(low) + np.float64(e) * span) for e in ends)
    return np.clip(first, low, high) + kind(0), np.clip(last, low, high) + kind(0)


# ---- Trained scales --------------------------------------------------------------------------


def decode_scaled(data: bytes, shape: Zyx, dtype: DTypeLike, block: Zyx, bits: int) -> Array:
    """The voxels of a well-formed code with trained scales: a fixed code, scales, choices."""
    sample, places = np.dtype(dtype), list(blocks(shape, _no_larger(block, shape)))
    choices_begin = len(data) - -(-len(places) // 2)
    scales_begin = choices_begin - 2 * SCALES * 2**bits
    positions = np.frombuffer(data, "<u2", SCALES * 2**bits, scales_begin)
    scales = positions.reshape(SCALES, -1).astype(np.int64)
    ends = np.frombuffer(data, sample.newbyteorder("<"), 2 * len(places)).astype(sample)
    rows_begin = 2 * sample.itemsize * len(places)
    indices = reference.unpack_rows(data[rows_begin:scales_begin], shape, bits)
    out = np.empty(shape, sample)
    for number, (_, voxels) in enumerate(places):
        scale = data[choices_begin + number // 2] >> 4 * (number % 2) & 15
        low, high = ends[2 * number], ends[2 * number + 1]
        out[voxels] = at_positions(scales[scale][indices[voxels]], low, high)
    return out


def at_positions(positions: Array, low: Any, high: Any) -> Array:
    """Values at positions 0 to 65535 between two end points."""
    if low.dtype.kind == "f":
        span = np.float64(high) - np.float64(low)
        values: Array = (np.float64(low) + span * positions / SCALE_TOP).astype(np.float32)
        return np.where(positions == SCALE_TOP, high, np.clip(values, low, high))
    reach = int(high) - int(low)
    exact = int(low) + (reach * positions + SCALE_TOP // 2) // SCALE_TOP
    return exact.astype(low.dtype)


# ---- Helpers ---------------------------------------------------------------------------------


def _difference_dtype(sample: np.dtype[Any]) -> np.dtype[Any]:
    return np.dtype(sample.str.replace("u", "i"))


def _difference(values: Array, expected: Array | None) -> Array | None:
    """Values less their prediction; None where end points of the samples' width cannot hold it."""
    if expected is None:
        return None
    kind = _difference_dtype(values.dtype)
    if values.dtype.kind == "f":
        with np.errstate(over="ignore"):
            exact = (values.astype(np.float64) - expected.astype(np.float64)).astype(np.float32)
        return exact if np.isfinite(exact).all() else None
    wide = values.astype(np.int64) - expected.astype(np.int64)
    info = np.iinfo(kind)
    return wide.astype(kind) if info.min <= wide.min() and wide.max() <= info.max else None


def _reach(values: Array) -> float:
    return float(values.max()) - float(values.min())


def _no_larger(block: Zyx, shape: tuple[int, ...]) -> Zyx:
    z, y, x = (min(b, n) for b, n in zip(block, shape, strict=True))
    return z, y, x


def _cut(whole: Array, shape: tuple[int, ...]) -> Array:
    return whole[tuple(slice(n) for n in shape)]


def _pack(indices: Array, bits: int) -> bytes:
    return reference.pack_rows(indices.astype(np.uint8).reshape(1, 1, -1), bits)


def _unpack(payload: bytes, count: int, bits: int) -> NDArray[np.int64]:
    nbytes = count * bits // 8
    flat = reference.unpack_rows(payload[:nbytes], (1, 1, count), bits)
    return flat.ravel().astype(np.int64)
