"""How the bytes of a compressed brick lie in textures: no GL, only sizes and formats.

The bytes of a brick go to the GPU as they are. S3Dc code is two textures: end points (minimum and
maximum of each block) and indices (16-bit words, rows along x); a lossless brick is one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from octobrick.codec.errors import UnsupportedError
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.decoded_bricks import is_drawn
from octobrick.renderer.slab_format import SlabFormat
from octobrick.store.box import Zyx, ceil_div

TexelsXyz = tuple[int, int, int]

RUN_MAX: Final = 4
ROWS: Final = 8
"""An invocation decodes up to this many voxels along x in each of this many rows: what it takes to
find out where a brick lies is then spread over 32 voxels. Measured: see docs/adr/0002."""

# Texture formats by sample type: moderngl's name of the integer (or float) texture, the prefix of
# its sampler and the GLSL types of a voxel and a pair.
_GL_DTYPE: Final = {"uint8": "u1", "int8": "i1", "uint16": "u2", "int16": "i2", "float32": "f4"}


@dataclass(frozen=True, slots=True)
class CodePart:
    """A run of a brick's bytes that becomes a box of texels in one texture.

    Attributes:
        name: of the sampler in the decoder.
        components: 1 or 2.
        gl_dtype: moderngl's dtype of the texture.
        texels_xyz: of one brick.
        nbytes: of one brick.
    """

    name: str
    components: int
    gl_dtype: str
    texels_xyz: TexelsXyz
    nbytes: int


@dataclass(frozen=True, slots=True)
class CodeLayout:
    """Everything that decoding depends on, the same for all bricks of a level.

    Attributes:
        dtype: NumPy name of the sample type.
        brick_zyx: voxels of a brick.
        block_zyx: voxels of a block; None for raw bricks.
        bits: of an index; 0 for raw bricks.
        parts: the textures, in the order of the bytes.
    """

    dtype: str
    brick_zyx: Zyx
    block_zyx: Zyx | None
    bits: int
    parts: tuple[CodePart, ...]

    @classmethod
    def of(cls, source: BrickSource, level: int) -> CodeLayout:
        """The layout of the bricks of a level; voxels in the slab are the same for all levels.

        Raises:
            UnsupportedError: for a sample type without a texture format.
        """
        dtype, brick = np.dtype(source.dtype), source.brick_shape_zyx
        SlabFormat.of(dtype)  # refuses types that have none
        codec = source.level_codec(level)
        if codec is None:
            return cls(dtype.name, brick, None, 0, (_part("voxels", 1, dtype, brick[::-1]),))
        if not is_drawn(codec):
            raise UnsupportedError(
                f"the renderer decodes S3Dc at a fixed rate and with a linear scale, not "
                f"{codec!s:.200}; ingest the volume with bits",
                codec=f"{codec!s:.200}",
            )
        block, bits = codec.block, codec.bits
        assert bits is not None
        blocks_xyz = tuple(ceil_div(n, b) for n, b in zip(brick, block, strict=True))[::-1]
        words_xyz = (ceil_div(brick[2] * bits, 16), brick[1], brick[0])
        parts = (
            _part("end_points", 2, dtype, blocks_xyz),
            _part("indices", 1, np.dtype(np.uint16), words_xyz),
        )
        return cls(dtype.name, brick, block, bits, parts)

    @property
    def code_nbytes(self) -> int:
        """Bytes of one brick."""
        return sum(part.nbytes for part in self.parts)

    @property
    def slab_format(self) -> SlabFormat:
        """Of the texture that bricks are decoded into."""
        return SlabFormat.of(np.dtype(self.dtype))

    @property
    def run(self) -> int:
        """Voxels along x that one invocation decodes.

        They must share one block, and their indices (run·bits, starting at any multiple of that)
        must lie in two words.
        """
        if self.block_zyx is None:
            return RUN_MAX
        return next(
            n for n in (RUN_MAX, 2, 1) if self.block_zyx[2] % n == 0 and self._fits_window(n)
        )

    def _fits_window(self, run: int) -> bool:
        nbits = run * self.bits
        return max((i * nbits) % 16 for i in range(16)) + nbits <= 32

    @property
    def crosses_words(self) -> bool:
        """Whether the indices of a run can reach into a second word."""
        return 16 % (self.run * self.bits) != 0

    def decoder_values(self) -> dict[str, str | int | bool]:
        """What the decode shader's names stand for."""
        is_float = self.dtype == "float32"
        values: dict[str, str | int | bool] = {
            "IMAGE_FORMAT": self.slab_format.image,
            "IS_FLOAT": is_float,
            "SAMPLER_PREFIX": _GL_DTYPE[self.dtype][0].replace("f", ""),
        }
        info = np.iinfo(self.dtype) if not is_float else None
        values |= {"RUN": self.run, "ROWS": ROWS}
        values |= {"LOWEST": int(info.min) if info else 0, "HIGHEST": int(info.max) if info else 1}
        if self.block_zyx is None:
            return values | {"VALUE": "float" if is_float else "int"}
        return values | {
            "BITS": self.bits,
            "CROSSES_WORDS": self.crosses_words,
            "PAIR": "vec2" if is_float else "ivec2",
            "BLOCK_XYZ": xyz_text(self.block_zyx),
        }

    def fill_values(self) -> dict[str, str | int | bool]:
        """What the names of the shader for absent bricks stand for."""
        return {"IMAGE_FORMAT": self.slab_format.image, "RUN": self.run, "ROWS": ROWS}


def xyz_text(zyx: Zyx) -> str:
    """Components for a GLSL vector, x first."""
    return ", ".join(str(n) for n in reversed(zyx))


def _part(
    name: str, components: int, dtype: np.dtype[Any], texels_xyz: tuple[int, ...]
) -> CodePart:
    x, y, z = texels_xyz
    nbytes = x * y * z * components * dtype.itemsize
    return CodePart(name, components, _GL_DTYPE[dtype.name], (x, y, z), nbytes)
