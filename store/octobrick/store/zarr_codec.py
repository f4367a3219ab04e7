"""S3Dc as a codec of Zarr v3, registered through the ``zarr.codecs`` entry point.

With octobrick installed, ``zarr.open`` reads the voxels of every level without knowing more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
from zarr.abc.codec import ArrayBytesCodec
from zarr.core.common import JSON, parse_named_configuration

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.store.box import Zyx
from octobrick.store.zarr_chunk import brick_shape, chunk_of, require_array

if TYPE_CHECKING:
    from zarr.core.array_spec import ArraySpec
    from zarr.core.buffer import Buffer, NDBuffer

S3DC_NAME = "octobrick.s3dc"
S3DC_VERSION = 1


def s3dc_configuration(codec: S3dc) -> dict[str, JSON]:
    """The codec's parameters as they stand in ``zarr.json``."""
    return {"version": S3DC_VERSION, "block": list(codec.block), "bits": codec.bits}


def s3dc_from_configuration(configuration: object) -> S3dc:
    """The codec that a ``zarr.json`` describes.

    Raises:
        UnsupportedError: another version of the code.
        InvalidInputError: anything that is not a configuration of S3Dc.
    """
    if not isinstance(configuration, dict) or set(configuration) != {"version", "block", "bits"}:
        raise InvalidInputError(
            f"{S3DC_NAME}: configuration {configuration!r:.200} needs version, block and bits"
        )
    if configuration["version"] != S3DC_VERSION:
        raise UnsupportedError(
            f"{S3DC_NAME}: version {configuration['version']!r:.40} is not {S3DC_VERSION}, the one "
            "that this octobrick reads; install a newer octobrick"
        )
    block, bits = configuration["block"], configuration["bits"]
    if not (
        isinstance(block, list)
        and len(block) == 3
        and all(type(n) is int for n in block)
        and type(bits) is int
    ):
        raise InvalidInputError(f"{S3DC_NAME}: block {block!r:.60} or bits {bits!r:.20} not usable")
    return S3dc(block=cast("Zyx", tuple(block)), bits=bits)


@dataclass(frozen=True)
class S3dcZarrCodec(ArrayBytesCodec):
    """One Zarr chunk, whose axes before z, y, x have length 1, as one S3Dc brick.

    Args:
        block: voxels per block along z, y, x.
        bits: bits per index, 1 to 8.
    """

    is_fixed_size = True

    block: Zyx = (8, 8, 8)
    bits: int = 4

    @classmethod
    def from_dict(cls, data: dict[str, JSON]) -> Self:
        """The codec that an entry of ``codecs`` in ``zarr.json`` describes."""
        _, configuration = parse_named_configuration(data, S3DC_NAME)
        codec = s3dc_from_configuration(configuration)
        return cls(block=codec.block, bits=codec.bits)

    def to_dict(self) -> dict[str, JSON]:
        """The entry of ``codecs`` in ``zarr.json``."""
        return {"name": S3DC_NAME, "configuration": s3dc_configuration(self._codec)}

    def validate(self, *, shape: tuple[int, ...], dtype: Any, chunk_grid: Any) -> None:  # noqa: ARG002
        """Refuse arrays that S3Dc cannot hold, before anything is read or written.

        Raises:
            UnsupportedError: the sample type.
            InvalidInputError: fewer than three axes.
        """
        require_array(S3DC_NAME, shape, dtype)

    def compute_encoded_size(self, input_byte_length: int, chunk_spec: ArraySpec) -> int:  # noqa: ARG002
        """Bytes of one coded chunk, which S3Dc fixes beforehand."""
        return self._codec.encoded_nbytes(*_brick_of(chunk_spec))

    async def _decode_single(self, chunk_data: Buffer, chunk_spec: ArraySpec) -> NDBuffer:
        shape_zyx, dtype = _brick_of(chunk_spec)
        brick = self._codec.decode(cast("Any", chunk_data.as_numpy_array()), shape_zyx, dtype)
        return chunk_of(brick, chunk_spec)

    async def _encode_single(self, chunk_data: NDBuffer, chunk_spec: ArraySpec) -> Buffer | None:
        shape_zyx, _ = _brick_of(chunk_spec)
        code = self._codec.encode(chunk_data.as_numpy_array().reshape(shape_zyx))
        return chunk_spec.prototype.buffer.from_bytes(code)

    @property
    def _codec(self) -> S3dc:
        return S3dc(block=self.block, bits=self.bits)


def _brick_of(chunk_spec: ArraySpec) -> tuple[Zyx, np.dtype[Any]]:
    return brick_shape(S3DC_NAME, chunk_spec.shape), np.dtype(chunk_spec.dtype.to_native_dtype())
