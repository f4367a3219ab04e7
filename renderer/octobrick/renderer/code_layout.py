"""How the bytes of a compressed brick lie, and what decoders need to know of them: no GL here.

The bytes of a brick go to the GPU as they are, into a buffer of 32-bit words. What a shader must
know of them besides stands in its text: so everything that depends on a codec's parameters alone
is worked out by the compiler.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import UnsupportedError
from octobrick.renderer.brick_source import BlockCode, BrickSource
from octobrick.renderer.slab_format import SlabFormat
from octobrick.store.box import Zyx, ceil_div, grid_of

RUN_MAX: Final = 4
ROWS: Final = 8
"""An invocation decodes up to this many voxels along x in each of this many rows: what it takes to
find out where a brick lies is then spread over 32 voxels. Measured: see docs/adr/0002."""
ZEROBIT_CELL: Final = 4
"""Voxels of a zerobit cell along each axis. An invocation decodes one."""
BOUND_NBYTES: Final = 4
"""Behind a code with a width per block: the error that blocks of a single value may have."""

Form = Literal["raw", "s3dc", "s3dc_variable", "zerobit", "directions"]
"""What a brick's bytes are; each has a shader, decode_*.comp.glsl."""
Values = dict[str, str | int | bool]

# Of a zerobit code, docs/spec/zerobit.md: header and end, codewords, and what a unit block takes
# at most with its pointer and its threshold.
_ZEROBIT_FRAME_NBYTES = 64 + 8
_ZEROBIT_CODEWORDS_MAX = 2 * 256
_ZEROBIT_UNIT_NBYTES_MAX = (1 + 8 + 5 * 64 + 640 + 4032) + 4 + 1
_ZEROBIT_UNIT_ZYX = (16, 16, 16)


@dataclass(frozen=True, slots=True)
class CodeLayout:
    """Everything that decoding depends on, the same for all bricks of a level.

    Attributes:
        form: what the bytes are.
        dtype: NumPy name of the sample type.
        brick_zyx: voxels of a brick.
        codec: what decodes the bytes; None for raw voxels and for directions.
    """

    form: Form
    dtype: str
    brick_zyx: Zyx
    codec: S3dc | Zerobit | None = None

    @classmethod
    def of(cls, source: BrickSource, level: int) -> CodeLayout:
        """The layout of the bricks of a level; voxels in the slab are the same for all levels.

        Raises:
            UnsupportedError: for a sample type without a texture format, or another codec.
        """
        dtype, brick = np.dtype(source.dtype), source.brick_shape_zyx
        SlabFormat.of(dtype)  # refuses types that have none
        codec = given = source.level_codec(level)
        if codec is None:
            return cls("raw", dtype.name, brick)
        if isinstance(codec, Zerobit):
            return cls("zerobit", dtype.name, brick, codec)
        codec = codec if isinstance(codec, S3dc) else _fixed_rate(codec)
        if codec is None:
            raise UnsupportedError(
                f"the renderer decodes S3Dc and zerobit, not {given!s:.200}; ingest the volume "
                "with one of these, or without a codec",
                codec=f"{given!s:.200}",
            )
        return cls("s3dc" if codec.bits else "s3dc_variable", dtype.name, brick, codec)

    @property
    def sample(self) -> np.dtype[Any]:
        """The sample type, as it lies in a code."""
        return np.dtype(self.dtype).newbyteorder("<")

    @property
    def has_one_size(self) -> bool:
        """Whether all bricks have the same number of bytes."""
        return self.form in ("raw", "s3dc", "directions")

    @property
    def has_blocks(self) -> bool:
        """Whether voxels are coded in blocks, whose borders show."""
        return self.form in ("s3dc", "s3dc_variable", "zerobit")

    @property
    def code_nbytes(self) -> int:
        """Bytes of one brick; the most that there can be where not all have the same."""
        nvoxels, itemsize = math.prod(self.brick_zyx), self.sample.itemsize
        if self.form == "directions":
            return 3 * nvoxels
        if self.form == "raw":
            return nvoxels * itemsize
        if self.form == "zerobit":
            nunits = math.prod(grid_of(self.brick_zyx, _ZEROBIT_UNIT_ZYX))
            words_nbytes = _ZEROBIT_CODEWORDS_MAX * itemsize
            return _ZEROBIT_FRAME_NBYTES + words_nbytes + nunits * _ZEROBIT_UNIT_NBYTES_MAX
        assert isinstance(self.codec, S3dc)
        if self.form == "s3dc":
            return self.codec.encoded_nbytes(self.brick_zyx, self.sample)
        units = 8 * itemsize * math.prod(self.blocks_zyx)
        return self._payload_begin + units * self._unit_nbytes + BOUND_NBYTES

    @property
    def block_zyx(self) -> Zyx:
        """Voxels of a block of S3Dc, none longer than the brick; of a cell of zerobit."""
        if self.form == "zerobit":
            return (ZEROBIT_CELL,) * 3
        assert isinstance(self.codec, S3dc)
        z, y, x = (min(b, n) for b, n in zip(self.codec.block, self.brick_zyx, strict=True))
        return (z, y, x)

    @property
    def blocks_zyx(self) -> Zyx:
        """Blocks of a brick."""
        return grid_of(self.brick_zyx, self.block_zyx)

    @property
    def bits(self) -> int:
        """Of an index of S3Dc at a fixed rate."""
        assert isinstance(self.codec, S3dc)
        assert self.codec.bits is not None
        return self.codec.bits

    @property
    def per_invocation_zyx(self) -> Zyx:
        """Voxels that one invocation of the decoder handles."""
        if self.form == "zerobit":
            return (ZEROBIT_CELL,) * 3
        return (1, ROWS, self.run)

    @property
    def run(self) -> int:
        """Voxels along x that one invocation decodes; they share a block of S3Dc.

        It divides the brick, so that none reads behind its bytes; and indices of up to 8 bits lie
        in at most two words.
        """
        edges = [self.brick_zyx[2]]
        if self.form in ("s3dc", "s3dc_variable"):
            edges.append(self.block_zyx[2])
        return next(n for n in (RUN_MAX, 2, 1) if all(edge % n == 0 for edge in edges))

    @property
    def crosses_words(self) -> bool:
        """Whether the indices of a run can reach into a second word, at a fixed rate."""
        row_nbits = 16 * ceil_div(self.brick_zyx[2] * self.bits, 16)
        first = 16 * self.sample.itemsize * math.prod(self.blocks_zyx)
        starts = {
            (first + y * row_nbits + x * self.bits) % 32
            for y in range(2)
            for x in range(0, min(self.brick_zyx[2], 32 * self.run), self.run)
        }
        return max(starts) + self.run * self.bits > 32

    @property
    def decoder(self) -> str:
        """The shader's file."""
        return f"decode_{self.form}.comp.glsl"

    def decoder_values(self, texel: SlabFormat) -> Values:
        """What the decode shader's names stand for.

        Args:
            texel: of the texture that is decoded into.
        """
        values: Values = {"IMAGE_FORMAT": texel.image, "BRICK_XYZ": xyz_text(self.brick_zyx)}
        _, rows, run = self.per_invocation_zyx
        values |= {"ROWS": rows, "RUN": run}
        if self.form == "directions":
            return values
        values |= self.sample_values()
        if self.form == "s3dc":
            values |= {"CROSSES_WORDS": self.crosses_words}
        if self.form in ("s3dc", "s3dc_variable"):
            return values | self.block_values()
        return values

    def sample_values(self) -> Values:
        """What names stand for that depend on the sample type."""
        is_float = self.sample.kind == "f"
        info = np.iinfo(self.sample) if not is_float else None
        return {
            "IS_FLOAT": is_float,
            "IS_SIGNED": self.sample.kind == "i",
            "SAMPLE_NBYTES": self.sample.itemsize,
            "LOWEST": int(info.min) if info else 0,
            "HIGHEST": int(info.max) if info else 1,
        }

    def block_values(self) -> Values:
        """What names stand for that depend on S3Dc's parameters."""
        assert isinstance(self.codec, S3dc)
        values: Values = {"BLOCK_XYZ": xyz_text(self.block_zyx)}
        if self.form == "s3dc":
            return values | {"BITS": self.bits, "SCALED": self.codec.scale == "trained"}
        return values

    @property
    def _unit_nbytes(self) -> int:
        return 4 * ceil_div(math.prod(self.block_zyx), 32)

    @property
    def _payload_begin(self) -> int:
        nblocks = math.prod(self.blocks_zyx)
        return 4 * ceil_div(2 * self.sample.itemsize * nblocks, 4) + 8 * ceil_div(nblocks, 8)


def _fixed_rate(codec: object) -> S3dc | None:
    """A source's own description of S3Dc at a fixed rate, as the codec that it means."""
    if isinstance(codec, BlockCode) and codec.bits is not None and codec.scale == "linear":
        return S3dc(codec.block, codec.bits)
    return None


def fill_values(texel: SlabFormat) -> Values:
    """What the names of the shader for absent bricks stand for."""
    return {"IMAGE_FORMAT": texel.image, "RUN": RUN_MAX, "ROWS": ROWS}


def xyz_text(zyx: Zyx) -> str:
    """Components for a GLSL vector, x first."""
    return ", ".join(str(n) for n in reversed(zyx))
