"""Voxels of another sample type: exactly, or through a window that the caller chooses."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.store.box import Box
from octobrick.store.sources.base import Rescale, Source
from octobrick.store.sources.wrapped import WrappedSource
from octobrick.store.zarr_chunk import SUPPORTED_DTYPES

Window = tuple[float, float]

# Those that lose nothing need not be asked for.
_BY_ITSELF = {"bool": "uint8", "float16": "float32"}


def stored_dtype(dtype: np.dtype[Any], convert: str | None) -> np.dtype[Any]:
    """The sample type in which a source is stored.

    Raises:
        UnsupportedError: the source's type cannot be stored and no conversion was asked for.
        InvalidInputError: a conversion to a type that volumes do not hold.
    """
    if convert is not None:
        if convert not in SUPPORTED_DTYPES:
            raise InvalidInputError(
                f"--convert {convert}: volumes hold {', '.join(sorted(SUPPORTED_DTYPES))}",
                dtype=convert,
            )
        return np.dtype(convert)
    name = _BY_ITSELF.get(dtype.name, dtype.name)
    if name not in SUPPORTED_DTYPES:
        raise UnsupportedError(
            f"voxels are {dtype.name}; volumes hold {', '.join(sorted(SUPPORTED_DTYPES))}, so say "
            "what to convert them to: --convert uint16 where every value fits, --convert uint16 "
            "--window LOW,HIGH to map a range of values, or --convert float32",
            dtype=dtype.name,
        )
    return np.dtype(name)


def converted(source: Source, convert: str | None, window: Window | None) -> Source:
    """The source itself where nothing is to be done, else one whose voxels are converted.

    Raises:
        What `stored_dtype` raises, and InvalidInputError for a window that maps nothing.
    """
    dtype = stored_dtype(source.dtype, convert)
    if window is not None:
        low, high = window
        if not (np.isfinite([low, high]).all() and low < high):
            raise InvalidInputError(f"--window {low:g},{high:g}: must be finite and ascending")
        if dtype.kind == "f":
            raise InvalidInputError(
                "--window maps to whole numbers; leave it out with float32, which keeps values, "
                "or add --convert uint8 or uint16"
            )
    if dtype == source.dtype and window is None:
        return source
    return ConvertedSource(source, dtype, window)


class ConvertedSource(WrappedSource):
    """A source with voxels of another type.

    Without a window every value must fit: whole numbers stay as they are, floats for whole
    numbers are rounded half to even, wider floats to the nearest float32. With one, its ends map
    to the ends of the type, and what lies beyond becomes the ends.
    """

    def __init__(self, source: Source, dtype: np.dtype[Any], window: Window | None) -> None:
        super().__init__(source)
        self.dtype = dtype
        self._window = window
        if window is not None:
            info = np.iinfo(dtype)
            slope = (window[1] - window[0]) / (info.max - info.min)
            value = source.rescale or Rescale(1.0, 0.0)
            intercept = value.slope * (window[0] - slope * info.min) + value.intercept
            self.rescale = Rescale(value.slope * slope, intercept)
        self.background = float(self._convert(np.array([source.background]))[0])

    def describe(self) -> dict[str, Any]:
        """What the source says, and what became of its samples."""
        window = self._window and list(self._window)
        return super().describe() | {"stored_as": self.dtype.name, "window": window}

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:
        return self._convert_of(self._source.read(box, t, c), box)

    def _read_channels(self, box: Box, t: int) -> npt.NDArray[Any]:
        return self._convert_of(self._source.read_channels(box, t), box)

    def _constant(self, box: Box, t: int, c: int) -> float | None:
        value = self._source.constant(box, t, c)
        return None if value is None else float(self._convert(np.array([value]))[0])

    def _convert_of(self, voxels: npt.NDArray[Any], box: Box) -> npt.NDArray[Any]:
        if self._window is None and self.dtype.kind in "iu" and voxels.dtype.kind != "b":
            self._require_fit(voxels, box)
        return self._convert(voxels)

    def _convert(self, voxels: npt.NDArray[Any]) -> npt.NDArray[Any]:
        if self._window is None:
            if voxels.dtype.kind == "f" and self.dtype.kind != "f":
                voxels = np.rint(voxels)
            with np.errstate(over="ignore"):  # beyond float32: infinite, which ingest refuses
                return voxels.astype(self.dtype)
        low, high = self._window
        info = np.iinfo(self.dtype)
        share = (np.clip(voxels.astype(np.float64), low, high) - low) / (high - low)
        return np.rint(share * (int(info.max) - int(info.min)) + int(info.min)).astype(self.dtype)

    def _require_fit(self, voxels: npt.NDArray[Any], box: Box) -> None:
        info = np.iinfo(self.dtype)
        # Written so that NaN does not fit.
        fits = (voxels >= info.min) & (voxels <= info.max)
        if fits.all():
            return
        at = np.argwhere(~fits)[0]
        voxel_zyx = [int(a) + start for a, start in zip(at[-3:], box.start_zyx, strict=True)]
        raise InvalidInputError(
            f"{self.path}: voxel (z, y, x) = {tuple(voxel_zyx)} is {voxels[tuple(at)]}, which does "
            f"not fit into {self.dtype} ({info.min} to {info.max}); give --window LOW,HIGH or "
            "another type",
            path=str(self.path),
            voxel_zyx=voxel_zyx,
        )
