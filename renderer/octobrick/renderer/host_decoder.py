"""Decodes parts of bricks on the CPU, into their place among the voxels of a box. No GL."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.deblock import s3dc_bounds, zerobit_bounds
from octobrick.codec.errors import CorruptBrickError, UnsupportedError
from octobrick.renderer.brick_request import Kind
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.slab_format import SlabFormat
from octobrick.store.box import Box, Zyx, ceil_div, grid_of

Voxels = NDArray[Any]

CUT_SHARE: Final = 0.75
"""Of a brick's voxels, up to which it pays to cut a code instead of decoding all of it."""


def kind_of(codec: object) -> Kind:
    """Whether codes are decoded here, or come as voxels from a volume that knows how."""
    return "voxels" if codec is None or isinstance(codec, S3dc | Zerobit) else "decoded"


class HostDecoder:
    """What decodes the bricks of a level. Safe to use from several threads.

    Raises:
        UnsupportedError: a sample type without a texture format, or a codec that only the volume
            could decode, which does not.
    """

    def __init__(self, source: BrickSource, level: int) -> None:
        self.dtype = np.dtype(source.dtype).newbyteorder("=")
        SlabFormat.of(self.dtype)  # refuses types that have none
        self.level = level
        self.brick_zyx = source.brick_shape_zyx
        self._codec = source.level_codec(level)
        self._fill_value = source.fill_value
        self.kind = kind_of(self._codec)
        if self.kind == "decoded":
            if not hasattr(source, "brick"):
                raise UnsupportedError(
                    f"the renderer knows no codec {self._codec!s:.200}, and the volume does not "
                    "decode its bricks; ingest it with S3Dc or zerobit",
                    codec=f"{self._codec!s:.200}",
                )
            self._codec = None

    def decode(self, code: bytes | None, brick_zyx: Zyx, part: Box, out: Voxels) -> None:
        """Write a part of a brick's voxels, counted from its first, to an array of that shape.

        Raises:
            CorruptBrickError: naming the brick.
        """
        if code is None:
            out[...] = self._fill_value
            return
        try:
            self._decode(code, part, out)
        except CorruptBrickError as error:
            raise self._named(error, brick_zyx) from error

    def bounds(self, code: bytes | None, brick_zyx: Zyx, block_zyx: Zyx) -> NDArray[np.float32]:
        """By how much the filter may move the voxels of each block of a brick.

        Raises:
            CorruptBrickError: naming the brick.
        """
        if code is None or self._codec is None:
            return np.zeros(grid_of(self.brick_zyx, block_zyx), np.float32)
        try:
            if isinstance(self._codec, Zerobit):
                return zerobit_bounds(self._codec, code)
            assert isinstance(self._codec, S3dc)
            return s3dc_bounds(self._codec, code, self.brick_zyx, self.dtype)
        except CorruptBrickError as error:
            raise self._named(error, brick_zyx) from error

    def _decode(self, code: bytes, part: Box, out: Voxels) -> None:
        if self._codec is None:
            out[...] = self._raw(code)[part.slices]
            if self.dtype.kind == "f" and not np.isfinite(out).all():
                raise CorruptBrickError("a voxel is NaN or infinite: not what ingest writes")
            return
        whole = Box.of_shape(self.brick_zyx)
        if isinstance(self._codec, Zerobit):
            out[...] = self._codec.decode(code, self.brick_zyx, self.dtype, threads=1)[part.slices]
            return
        assert isinstance(self._codec, S3dc)
        if part != whole:
            code, whole = self._cut(code, part) or (code, whole)
        if part == whole:
            self._codec.decode(code, whole.shape_zyx, self.dtype, out=out, threads=1)
            return
        voxels = self._codec.decode(code, whole.shape_zyx, self.dtype, threads=1)
        out[...] = voxels[part.shift(_negative(whole.start_zyx)).slices]

    def _raw(self, code: bytes) -> Voxels:
        expected = math.prod(self.brick_zyx) * self.dtype.itemsize
        if len(code) != expected:
            raise CorruptBrickError(
                f"{len(code)} bytes of raw voxels, expected {expected}",
                nbytes=len(code),
                expected_nbytes=expected,
            )
        return np.frombuffer(code, self.dtype.newbyteorder("<")).reshape(self.brick_zyx)

    def _cut(self, code: bytes, part: Box) -> tuple[bytes, Box] | None:
        """The code of whole rows of blocks around a part; None where cutting does not pay.

        Codes at a fixed rate are rows of end points and rows of indices, each of one length.
        """
        codec, (nz, ny, nx) = self._codec, self.brick_zyx
        assert isinstance(codec, S3dc)
        if codec.variable or codec.scale != "linear":
            return None
        bz, by, _ = codec.block
        (z, y, _), (z_stop, y_stop, _) = part.start_zyx, part.stop_zyx
        z, y = z // bz * bz, y // by * by
        z_stop, y_stop = min(ceil_div(z_stop, bz) * bz, nz), min(ceil_div(y_stop, by) * by, ny)
        if (z_stop - z) * (y_stop - y) > CUT_SHARE * nz * ny:
            return None
        if len(code) != codec.encoded_nbytes(self.brick_zyx, self.dtype):
            return None  # which the codec refuses
        grid = grid_of(self.brick_zyx, codec.block)
        octets = np.frombuffer(code, np.uint8)
        ends_nbytes = codec.end_points_nbytes(self.brick_zyx, self.dtype)
        ends = octets[:ends_nbytes].reshape(grid[0], grid[1], -1)
        rows = octets[ends_nbytes:].reshape(nz, ny, -1)
        ends = ends[z // bz : ceil_div(z_stop, bz), y // by : ceil_div(y_stop, by)]
        cut = ends.tobytes() + rows[z:z_stop, y:y_stop].tobytes()
        return cut, Box((z, y, 0), (z_stop, y_stop, nx))

    def _named(self, error: CorruptBrickError, brick_zyx: Zyx) -> CorruptBrickError:
        facts = error.facts | {"level": self.level, "brick_zyx": list(brick_zyx)}
        return CorruptBrickError(
            f"brick {brick_zyx} of level {self.level}: {error.message}; fetch it again or "
            "re-ingest the volume",
            **facts,
        )


def _negative(zyx: Zyx) -> Zyx:
    z, y, x = zyx
    return (-z, -y, -x)
