"""How decoded voxels and directions lie in the textures that rays sample: no GL, only formats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from octobrick.codec.errors import UnsupportedError


@dataclass(frozen=True, slots=True)
class SlabFormat:
    """A texture format that hardware interpolates: normalised integers or floats.

    Attributes:
        gl_dtype: moderngl's name of it.
        image: GLSL's image format.
        range_image: GLSL's image format of pairs of the same, for the ranges of cells.
        components: 1 for voxels, 4 for directions.
        voxel_nbytes: of one texel.
    """

    gl_dtype: str
    image: str
    range_image: str
    components: int
    voxel_nbytes: int

    @classmethod
    def of(cls, dtype: np.dtype[Any], *, deblocked: bool = False) -> SlabFormat:
        """The format for voxels of a sample type; deblocked ones lie between 8-bit values.

        Raises:
            UnsupportedError: for a sample type without a texture format.
        """
        if dtype.name not in _FORMATS:
            raise UnsupportedError(
                f"the renderer takes {', '.join(_FORMATS)} voxels, not {dtype}; ingest the volume "
                "with one of these types",
                dtype=str(dtype),
            )
        return BITS_16 if deblocked and dtype.itemsize == 1 else _FORMATS[dtype.name]


BITS_8: Final = SlabFormat("f1", "r8", "rg8", 1, 1)
BITS_16: Final = SlabFormat("nu2", "r16", "rg16", 1, 2)
FLOATS: Final = SlabFormat("f4", "r32f", "rg32f", 1, 4)
DIRECTIONS: Final = SlabFormat("f1", "rgba8", "", 4, 4)
"""Codes of gradient directions: three bytes and one unused."""

_FORMATS: Final = {
    "uint8": BITS_8, "int8": BITS_8, "uint16": BITS_16, "int16": BITS_16, "float32": FLOATS,
}  # fmt: skip
