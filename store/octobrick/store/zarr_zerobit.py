"""Zerobit as a codec of Zarr v3, registered through the ``zarr.codecs`` entry point.

docs/spec/zerobit.md says what its configuration and its chunks are.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
from zarr.abc.codec import ArrayBytesCodec
from zarr.core.common import JSON, parse_named_configuration

from octobrick.codec import Codebook, Zerobit
from octobrick.codec.errors import InvalidInputError, OctobrickError, UnsupportedError
from octobrick.store.zarr_chunk import chunk_of, require_array

if TYPE_CHECKING:
    from zarr.core.array_spec import ArraySpec
    from zarr.core.buffer import Buffer, NDBuffer

ZEROBIT_NAME = "octobrick.zerobit"
ZEROBIT_VERSION = 1
_NEEDED = {"version", "codebook"}  # by a reader; all else guides the writer
_ALL = _NEEDED | {"ratio", "thresholds", "ranking", "count_averages", "background"}
_COLOURS = 3


def zerobit_configuration(codec: Zerobit) -> dict[str, JSON]:
    """The codec's parameters as they stand in ``zarr.json``."""
    background, codebook = codec.background, codec.codebook
    return {
        "version": ZEROBIT_VERSION,
        "ratio": codec.ratio,
        "thresholds": codec.thresholds,
        "ranking": codec.ranking,
        "count_averages": codec.count_averages,
        "background": list(background) if isinstance(background, tuple) else background,
        "codebook": None if codebook is None else base64.b64encode(codebook.data).decode(),
    }


def zerobit_from_configuration(configuration: object) -> Zerobit:
    """The codec that a ``zarr.json`` describes.

    Raises:
        UnsupportedError: another version of the code.
        InvalidInputError: anything that is not a configuration of Zerobit.
    """
    if not isinstance(configuration, dict) or not set(configuration) >= _NEEDED:
        raise InvalidInputError(
            f"{ZEROBIT_NAME}: configuration {configuration!r:.200} needs version and codebook"
        )
    if configuration["version"] != ZEROBIT_VERSION:
        raise UnsupportedError(
            f"{ZEROBIT_NAME}: version {configuration['version']!r:.40} is not {ZEROBIT_VERSION}, "
            "the one that this octobrick reads; install a newer octobrick"
        )
    if unknown := sorted(str(name) for name in set(configuration) - _ALL):
        raise InvalidInputError(
            f"{ZEROBIT_NAME}: configuration has {unknown!r:.100}, which is none of {sorted(_ALL)}"
        )
    settings: dict[str, Any] = {k: v for k, v in configuration.items() if k != "version"}
    if not _is_number(settings.get("ratio", 0)):
        raise InvalidInputError(f"{ZEROBIT_NAME}: ratio {settings['ratio']!r:.40} is no number")
    if not isinstance(settings.get("count_averages", False), bool):
        raise InvalidInputError(f"{ZEROBIT_NAME}: count_averages must be true or false")
    settings["background"] = _background_from(settings.get("background"))
    settings["codebook"] = _codebook_from(settings["codebook"])
    return Zerobit(**settings)


@dataclass(frozen=True)
class ZerobitZarrCodec(ArrayBytesCodec):
    """One Zarr chunk as one zerobit code: z, y, x are its last axes.

    All axes before them have length 1, with one exception: where the axis next to z has length 3,
    these are the colours of each voxel. An array whose colours come last is brought into this
    order by Zarr's own codec ``transpose``.

    Args:
        codec: how to encode; a reader needs nothing of it but the codebook.
    """

    is_fixed_size = False

    codec: Zerobit = field(default_factory=Zerobit)

    @classmethod
    def from_dict(cls, data: dict[str, JSON]) -> Self:
        """The codec that an entry of ``codecs`` in ``zarr.json`` describes."""
        _, configuration = parse_named_configuration(data, ZEROBIT_NAME)
        return cls(zerobit_from_configuration(configuration))

    def to_dict(self) -> dict[str, JSON]:
        """The entry of ``codecs`` in ``zarr.json``."""
        return {"name": ZEROBIT_NAME, "configuration": zerobit_configuration(self.codec)}

    def evolve_from_array_spec(self, array_spec: ArraySpec) -> Self:
        """Itself; refuses what `validate` does, which Zarr does not call for codecs in shards."""
        native = require_array(ZEROBIT_NAME, array_spec.shape, array_spec.dtype)
        self._require_usable(native, channels=(1, _COLOURS))
        return self

    def validate(self, *, shape: tuple[int, ...], dtype: Any, chunk_grid: Any) -> None:
        """Refuse arrays that Zerobit cannot hold, before anything is read or written.

        Shapes are those before a ``transpose``: whether the colours are where they should be
        shows when a chunk comes.

        Raises:
            UnsupportedError: the sample type.
            InvalidInputError: fewer than three axes, chunks of more than one brick, a background
                that the type has not, or a codebook for another type.
        """
        native = require_array(ZEROBIT_NAME, shape, dtype)
        longer = [n for n in getattr(chunk_grid, "chunk_shape", ()) if n != 1]
        if len(longer) > 4 or (len(longer) == 4 and _COLOURS not in longer):
            raise _more_than_a_brick(chunk_grid.chunk_shape)
        if len(longer) == 4:
            self._require_usable(native, channels=(_COLOURS,))
        else:
            self._require_usable(native, channels=(1, _COLOURS) if _COLOURS in longer else (1,))

    def compute_encoded_size(self, input_byte_length: int, chunk_spec: ArraySpec) -> int:
        """Not known beforehand."""
        raise NotImplementedError

    async def _decode_single(self, chunk_data: Buffer, chunk_spec: ArraySpec) -> NDBuffer:
        return await asyncio.to_thread(self._decode, chunk_data, chunk_spec)

    async def _encode_single(self, chunk_data: NDBuffer, chunk_spec: ArraySpec) -> Buffer | None:
        return await asyncio.to_thread(self._encode, chunk_data, chunk_spec)

    def _decode(self, chunk_data: Buffer, chunk_spec: ArraySpec) -> NDBuffer:
        shape = _image_shape(chunk_spec.shape)
        dtype = np.dtype(chunk_spec.dtype.to_native_dtype())
        image = self.codec.decode(cast("Any", chunk_data.as_numpy_array()), shape, dtype)
        return chunk_of(np.moveaxis(image, 3, 0) if len(shape) == 4 else image, chunk_spec)

    def _encode(self, chunk_data: NDBuffer, chunk_spec: ArraySpec) -> Buffer:
        voxels, shape = chunk_data.as_numpy_array(), _image_shape(chunk_spec.shape)
        if len(shape) == 4:
            image = np.moveaxis(voxels.reshape(_COLOURS, *shape[:3]), 0, 3)
        else:
            image = voxels.reshape(shape)
        return chunk_spec.prototype.buffer.from_bytes(self.codec.encode(image))

    def _require_usable(self, native: np.dtype[Any], channels: tuple[int, ...]) -> None:
        """One voxel tells whether background and codebook are of this type and these channels."""
        faults = []
        for count in channels:
            try:
                self.codec.encode(np.zeros((1, 1, 1, count)[: 3 if count == 1 else 4], native))
            except OctobrickError as error:
                faults.append(error)
        if len(faults) == len(channels):
            raise faults[0]


def _image_shape(chunk_shape: tuple[int, ...]) -> tuple[int, ...]:
    """(z, y, x), or (z, y, x, 3) where the axis next to z has the colours."""
    *leading, nz, ny, nx = chunk_shape
    colours = (_COLOURS,) if leading[-1:] == [_COLOURS] else ()
    if any(n != 1 for n in leading[: len(leading) - len(colours)]):
        raise _more_than_a_brick(chunk_shape)
    return (nz, ny, nx, *colours)


def _more_than_a_brick(chunk_shape: tuple[int, ...]) -> InvalidInputError:
    return InvalidInputError(
        f"{ZEROBIT_NAME}: chunk shape {chunk_shape} must be 1 along the axes before z, y, x; the "
        f"one next to z may be {_COLOURS}, for colours (bring colours that come last there with "
        "the codec transpose)"
    )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _background_from(value: object) -> float | tuple[float, ...] | None:
    colours = value if isinstance(value, list) else [value]
    if value is None or (all(map(_is_number, colours)) and len(colours) in (1, _COLOURS)):
        return tuple(value) if isinstance(value, list) else cast("float | None", value)
    raise InvalidInputError(
        f"{ZEROBIT_NAME}: background {value!r:.60} is neither a number, nor three, nor null"
    )


def _codebook_from(value: object) -> Codebook | None:
    if value is None:
        return None
    try:
        data = base64.b64decode(cast("str", value), validate=True)
    except (TypeError, ValueError, binascii.Error) as error:
        raise InvalidInputError(
            f"{ZEROBIT_NAME}: codebook {value!r:.40} is neither null nor base64: {error}"
        ) from error
    if not data:  # which Zerobit would take for none
        raise InvalidInputError(f"{ZEROBIT_NAME}: codebook is empty; null stands for none")
    return Codebook(data)
