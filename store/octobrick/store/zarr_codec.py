"""S3Dc as a codec of Zarr v3, registered through the ``zarr.codecs`` entry point.

With octobrick installed, ``zarr.open`` reads the voxels of every level without knowing more.
"""

from __future__ import annotations

from dataclasses import dataclass, field
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
_TYPES: dict[str, tuple[type, ...]] = {
    "bits": (int,),
    "max_error": (int, float),
    "bits_per_voxel": (int, float),
    "slope": (int, float),
    "fitted": (bool,),
    "scale": (str,),
}
_RULES = ("bits", "max_error", "bits_per_voxel", "slope")


def s3dc_configuration(codec: S3dc) -> dict[str, JSON]:
    """The codec's parameters as they stand in ``zarr.json``: those that are not the default."""
    configuration: dict[str, JSON] = {"version": S3DC_VERSION, "block": list(codec.block)}
    for name in _RULES:
        if (value := getattr(codec, name)) is not None:
            configuration[name] = value
    # Of the others only the scale matters to a reader.
    plain = S3dc(codec.block, **{n: getattr(codec, n) for n in _RULES})
    for name in ("fitted", "scale"):
        if (value := getattr(codec, name)) != getattr(plain, name):
            configuration[name] = value
    return configuration


def s3dc_from_configuration(configuration: object) -> S3dc:
    """The codec that a ``zarr.json`` describes.

    Raises:
        UnsupportedError: another version of the code.
        InvalidInputError: anything that is not a configuration of S3Dc.
    """
    if not isinstance(configuration, dict) or not {"version", "block"} <= set(configuration):
        raise InvalidInputError(
            f"{S3DC_NAME}: configuration {configuration!r:.200} needs version, block and bits"
        )
    if configuration["version"] != S3DC_VERSION:
        raise UnsupportedError(
            f"{S3DC_NAME}: version {configuration['version']!r:.40} is not {S3DC_VERSION}, the one "
            "that this octobrick reads; install a newer octobrick"
        )
    parameters = {k: v for k, v in configuration.items() if k not in ("version", "block")}
    block = configuration["block"]
    sound = (
        isinstance(block, list)
        and len(block) == 3
        and all(type(n) is int for n in block)
        and all(type(v) in _TYPES.get(k, ()) for k, v in parameters.items())
        and sum(k in _RULES for k in parameters) == 1
    )
    if not sound:
        raise InvalidInputError(
            f"{S3DC_NAME}: configuration {configuration!r:.200} has a block of three integers, one "
            f"of {', '.join(_RULES)}, and perhaps fitted and scale"
        )
    return S3dc(block=cast("Zyx", tuple(block)), **parameters)


def require_volume_codec(codec: S3dc) -> S3dc:
    """The codec, if volumes can hold its codes: those with a linear scale.

    Raises:
        UnsupportedError: they cannot.
    """
    if codec.scale != "linear":
        raise UnsupportedError(
            f"volumes hold S3Dc with a linear scale, not {codec} as yet; leave out the scale",
            codec=str(codec),
        )
    return codec


@dataclass(frozen=True)
class S3dcZarrCodec(ArrayBytesCodec):
    """One Zarr chunk, whose axes before z, y, x have length 1, as one S3Dc brick.

    Args:
        codec: any S3Dc. A `prediction` has no place here: Zarr's chunks know nothing of each other.
    """

    is_fixed_size = False  # only codes of a fixed rate are

    codec: S3dc = field(default_factory=S3dc)

    @classmethod
    def from_dict(cls, data: dict[str, JSON]) -> Self:
        """The codec that an entry of ``codecs`` in ``zarr.json`` describes."""
        _, configuration = parse_named_configuration(data, S3DC_NAME)
        return cls(s3dc_from_configuration(configuration))

    def to_dict(self) -> dict[str, JSON]:
        """The entry of ``codecs`` in ``zarr.json``."""
        return {"name": S3DC_NAME, "configuration": s3dc_configuration(self.codec)}

    def validate(self, *, shape: tuple[int, ...], dtype: Any, chunk_grid: Any) -> None:  # noqa: ARG002
        """Refuse arrays that S3Dc cannot hold, before anything is read or written.

        Raises:
            UnsupportedError: the sample type.
            InvalidInputError: fewer than three axes.
        """
        require_array(S3DC_NAME, shape, dtype)

    def compute_encoded_size(self, input_byte_length: int, chunk_spec: ArraySpec) -> int:  # noqa: ARG002
        """Bytes of one coded chunk, where they are fixed beforehand.

        Raises:
            InvalidInputError: they are not.
        """
        return self.codec.encoded_nbytes(*_brick_of(chunk_spec))

    async def _decode_single(self, chunk_data: Buffer, chunk_spec: ArraySpec) -> NDBuffer:
        shape_zyx, dtype = _brick_of(chunk_spec)
        brick = self.codec.decode(cast("Any", chunk_data.as_numpy_array()), shape_zyx, dtype)
        return chunk_of(brick, chunk_spec)

    async def _encode_single(self, chunk_data: NDBuffer, chunk_spec: ArraySpec) -> Buffer | None:
        shape_zyx, _ = _brick_of(chunk_spec)
        code = self.codec.encode(chunk_data.as_numpy_array().reshape(shape_zyx))
        return chunk_spec.prototype.buffer.from_bytes(code)


def _brick_of(chunk_spec: ArraySpec) -> tuple[Zyx, np.dtype[Any]]:
    return brick_shape(S3DC_NAME, chunk_spec.shape), np.dtype(chunk_spec.dtype.to_native_dtype())
