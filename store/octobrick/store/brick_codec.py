"""What a brick can be coded by, in one place: how it is named, encoded, decoded and bounded."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Zyx, grid_of
from octobrick.store.zarr_codec import (
    S3DC_NAME,
    S3dcZarrCodec,
    require_volume_codec,
    s3dc_configuration,
    s3dc_from_configuration,
)
from octobrick.store.zarr_zerobit import (
    ZEROBIT_NAME,
    ZerobitZarrCodec,
    zerobit_configuration,
    zerobit_from_configuration,
)

if TYPE_CHECKING:
    from zarr.abc.codec import ArrayBytesCodec

Voxels = NDArray[Any]

BrickCodec = S3dc | Zerobit | None
"""What turns a brick's voxels into bytes before zstd; None keeps them as they are."""

BYTES_NAME = "bytes"
# Of a zerobit code, docs/spec/zerobit.md: header and end, and what a unit block takes at most with
# its pointer and its threshold.
_ZEROBIT_FRAME_NBYTES = 64 + 8
_ZEROBIT_CODEWORDS_MAX = 2 * 256
_ZEROBIT_UNIT = 16
_ZEROBIT_UNIT_NBYTES_MAX = (1 + 8 + 5 * 64 + 640 + 4032) + 4 + 1


def codec_to_json(codec: BrickCodec) -> dict[str, Any]:
    """Name and parameters, as they stand in the attributes of a volume."""
    if codec is None:
        return {"name": BYTES_NAME}
    if isinstance(codec, Zerobit):
        return {"name": ZEROBIT_NAME, "configuration": zerobit_configuration(codec)}
    return {"name": S3DC_NAME, "configuration": s3dc_configuration(codec)}


def codec_from_json(value: object) -> BrickCodec:
    """The codec that `codec_to_json` described.

    Raises:
        InvalidInputError: it is no codec of volumes, or has parameters that it cannot have.
        UnsupportedError: another version of a code, or one whose codes volumes cannot hold.
    """
    name = value.get("name") if isinstance(value, dict) else None
    if isinstance(value, dict) and value == {"name": BYTES_NAME}:
        return None
    if isinstance(value, dict) and name == S3DC_NAME:
        return require_volume_codec(s3dc_from_configuration(value.get("configuration")))
    if isinstance(value, dict) and name == ZEROBIT_NAME:
        return zerobit_from_configuration(value.get("configuration"))
    raise InvalidInputError(
        f"codec {value!r:.80} is none of {BYTES_NAME}, {S3DC_NAME} and {ZEROBIT_NAME}; a newer "
        "octobrick may know it"
    )


def codec_text(codec: BrickCodec) -> str:
    """The codec for people and headers, such as ``s3dc; block=8,8,8; bits=4``, or ``raw``."""
    if codec is None:
        return "raw"
    if isinstance(codec, Zerobit):
        shared = "" if codec.codebook is None else "; codebook=shared"
        return f"zerobit; details={codec.ratio:.6g}{shared}"
    rule = next(n for n in ("bits", "max_error", "bits_per_voxel", "slope") if _has(codec, n))
    block = ",".join(str(n) for n in codec.block)
    return f"s3dc; block={block}; {rule}={getattr(codec, rule):.6g}"


def require_codec(codec: BrickCodec, dtype: np.dtype[Any] | None = None) -> BrickCodec:
    """The codec, if volumes, or volumes of this sample type, can hold its codes.

    Raises:
        UnsupportedError: it cannot code this sample type, or its codes are of no use in volumes.
        InvalidInputError: it is no codec, or has a codebook or background of another type.
    """
    if isinstance(codec, S3dc):
        require_volume_codec(codec)
    elif codec is not None and not isinstance(codec, Zerobit):
        raise InvalidInputError(f"codec {codec!r:.80}: give S3dc, Zerobit or None")
    if codec is not None and dtype is not None:
        encode(codec, np.zeros((4, 4, 4), dtype))  # says all that can be wrong
    return codec


def encode(codec: BrickCodec, voxels: Voxels) -> bytes:
    """The code of a brick's voxels (z, y, x)."""
    if codec is None:
        little = voxels.dtype.newbyteorder("<")
        return voxels.astype(little, order="C", copy=False).tobytes()
    return codec.encode(voxels)


def decode(codec: BrickCodec, code: bytes, shape_zyx: Zyx, dtype: np.dtype[Any]) -> Voxels:
    """The voxels of a code, whose size `code_nbytes_max` has bounded.

    Raises:
        CorruptBrickError: the bytes are not a code of this shape and type.
    """
    if codec is None:
        voxels = np.frombuffer(code, dtype.newbyteorder("<")).reshape(shape_zyx)
        return voxels.astype(dtype)
    return codec.decode(code, shape_zyx, dtype)


def has_one_size(codec: BrickCodec) -> bool:
    """Whether the codes of all bricks of one shape and type are of one size."""
    return codec is None or (isinstance(codec, S3dc) and not codec.variable)


def code_nbytes_max(codec: BrickCodec, shape_zyx: Zyx, dtype: np.dtype[Any]) -> int:
    """The most bytes that a code takes; what each takes, if `has_one_size`."""
    if codec is None:
        return math.prod(shape_zyx) * dtype.itemsize
    if isinstance(codec, Zerobit):
        nunits = math.prod(grid_of(shape_zyx, (_ZEROBIT_UNIT,) * 3))
        codebook_nbytes = _ZEROBIT_CODEWORDS_MAX * dtype.itemsize
        return _ZEROBIT_FRAME_NBYTES + codebook_nbytes + nunits * _ZEROBIT_UNIT_NBYTES_MAX
    if not codec.variable:
        return codec.encoded_nbytes(shape_zyx, dtype)
    # Voxels raw, and per block its end points and at most four words of tables.
    nblocks = math.prod(grid_of(shape_zyx, codec.block))
    padded_nbytes = nblocks * math.prod(codec.block) * dtype.itemsize
    return padded_nbytes + nblocks * (2 * dtype.itemsize + 16) + 1024


def zarr_serializer(codec: BrickCodec, dtype: np.dtype[Any]) -> ArrayBytesCodec:
    """The codec as Zarr takes it."""
    from zarr.codecs import BytesCodec

    if codec is None:
        return BytesCodec(endian=None if dtype.itemsize == 1 else "little")
    return ZerobitZarrCodec(codec) if isinstance(codec, Zerobit) else S3dcZarrCodec(codec)


def _has(codec: S3dc, rule: str) -> bool:
    return getattr(codec, rule) is not None
