"""Zerobit: wavelet compression of scalar and RGB volumes, any voxel decoded in constant time.

Bajaj, Ihm, Park, "3D RGB Image Compression for Interactive Applications", 2001. The bytes are
specified in docs/spec/zerobit.md; `octobrick.codec.reference_zerobit` is the same in plain numpy.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from octobrick.codec import _native
from octobrick.codec.arrays import SAMPLE_DTYPES, Voxels, Zyx, require_dtype
from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.codec.zerobit_arguments import (
    colour_of,
    require_cell_mask,
    require_image,
    require_image_shape,
    require_position,
    thread_count,
)
from octobrick.codec.zerobit_faults import cannot_encode, require_sound

if TYPE_CHECKING:
    from typing_extensions import Buffer

_OK = _native.ZerobitStatus.OK


@dataclass(frozen=True, slots=True)
class Codebook:
    """Codewords that many codes share, made by `Zerobit.train`: an immutable value.

    Args:
        data: its bytes, as docs/spec/zerobit.md has them; keep them wherever the codes are kept.
    """

    data: bytes


@dataclass(frozen=True, slots=True)
class ZerobitStats:
    """What a code is made of.

    Args:
        nbytes: all of it.
        pointers_nbytes: the table of unit blocks in it, which the literature does not count.
        codebook_nbytes: the codebook in it; 0 where that is shared.
        cells: cells of 4³ voxels that are not null.
        details: detail coefficients that are not null.
        null_nodes: of level 0 and of level 1, the share of detail nodes that are null in cells
            that are not (γ₀ and γ₁ of the paper); 1 where there are no such cells.
        background: what a null cell decodes to; a number per channel.
    """

    nbytes: int
    pointers_nbytes: int
    codebook_nbytes: int
    cells: int
    details: int
    null_nodes: tuple[float, float]
    background: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Zerobit:
    """A lossy wavelet code: cells of 4³ voxels keep their average and few detail coefficients.

    A cell that holds nothing but background costs nothing, so volumes of which only parts matter
    become small. Any voxel, plane or cell is decoded by itself, and two coarser levels of detail
    come from the same bytes. There is no bound of the error: see `block_thresholds` for its scale.

    An instance is an immutable value; every method is safe to call from many threads, and lets
    other Python threads run meanwhile. Results depend neither on the number of threads nor on the
    machine. Arrays are (z, y, x) of uint8, int8, uint16, int16 or float32, or colours
    (z, y, x, 3) of uint8 or uint16; one that is not C-contiguous is copied.

    Args:
        ratio: details to keep, as a share of all coefficients; 0 to 1. The paper takes 0.01 to
            0.07. Ties are kept, so a code can have somewhat more.
        codebook: what `train` returned; None puts an own codebook into every code.
        thresholds: "global" finds one threshold for all unit blocks; "block" gives each of them
            a share of the details, by how many it has (the paper's way, and worse: see
            docs/adr/0004-zerobit-has-one-threshold.md).
        ranking: "orthonormal" keeps what lowers the squared error most, "literal" what is
            greatest, as the paper has it.
        count_averages: whether averages compete with details, as the paper can be read; what
            ranks too low then becomes background, at low ratios nearly everything.
        background: what null cells decode to, a number, or three; None finds the commonest value
            of constant cells.

    Raises:
        InvalidInputError: a parameter is out of its range.
    """

    ratio: float = 0.05
    codebook: Codebook | None = None
    _: KW_ONLY
    thresholds: Literal["global", "block"] = "global"
    ranking: Literal["orthonormal", "literal"] = "orthonormal"
    count_averages: bool = False
    background: float | tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        try:
            ratio = float(self.ratio)
        except (TypeError, ValueError) as error:
            raise InvalidInputError(f"Zerobit ratio must be a number: {error}") from error
        if not 0 <= ratio <= 1:
            raise InvalidInputError(
                f"Zerobit ratio is {ratio}; give the share of details to keep, 0 to 1",
                ratio=str(ratio),
            )
        object.__setattr__(self, "ratio", ratio)
        for name, choices in (
            ("thresholds", ("global", "block")),
            ("ranking", ("orthonormal", "literal")),
        ):
            if getattr(self, name) not in choices:
                raise InvalidInputError(
                    f"Zerobit {name} is {getattr(self, name)!r}; give one of {choices}"
                )
        if self.codebook is not None and not isinstance(self.codebook, Codebook):
            raise InvalidInputError("Zerobit codebook must be what Zerobit.train returned")

    @classmethod
    def train(
        cls, arrays: Iterable[Voxels], *, like: Zerobit | None = None, threads: int | None = None
    ) -> Codebook:
        """A codebook for arrays of one type, to be shared by them and by others like them.

        Args:
            arrays: bricks or time steps; each is looked at once, and not kept.
            like: what will encode them, of which everything but the codebook counts.
            threads: as in `encode`.

        Raises:
            InvalidInputError: no arrays, or arrays of several types.
            NotFiniteError, UnsupportedError: as `encode`.
        """
        codec = like if like is not None else cls()
        trainer, first = None, None
        for array in arrays:
            image, channels = require_image(array)
            kind = (image.dtype, channels)
            if trainer is None:
                first = kind
                settings = codec._settings(image.dtype, channels)
                trainer = _native.ZerobitTrainer(_type(image.dtype), channels, settings)
            if kind != first:
                raise InvalidInputError(
                    f"a codebook is for one type, but there are arrays of {first} and of {kind}"
                )
            outcome = trainer.add(
                image, image.shape[:3], _type(image.dtype), channels, thread_count(threads)
            )
            if outcome.status is not _OK:
                raise cannot_encode(outcome, image.shape)
        if trainer is None:
            raise InvalidInputError("there are no arrays to train a codebook on; give at least one")
        return Codebook(trainer.codebook())

    def encode(
        self,
        array: Voxels,
        *,
        wanted: NDArray[np.bool_] | None = None,
        threads: int | None = None,
    ) -> bytes:
        """The code of an array.

        Args:
            array: (z, y, x), or (z, y, x, 3) for colours.
            wanted: a boolean per cell of 4³ voxels, of shape ceil(n/4); all others become null
                (the paper's selective compression), and `ratio` counts the wanted ones only.
            threads: how many may work; None is one, or all processors from 4 MiB on.

        Raises:
            InvalidInputError: another shape, or a codebook of another type.
            NotFiniteError: a float32 voxel is NaN or infinite.
            UnsupportedError: another sample type, or 4 GiB of code or more.
        """
        image, channels = require_image(array)
        shape = image.shape[:3]
        mask = require_cell_mask(wanted, shape)
        result = _native.zerobit_encode(
            image,
            shape,
            _type(image.dtype),
            channels,
            self._settings(image.dtype, channels),
            b"" if mask is None else mask,
            self._codebook_bytes(),
            thread_count(threads),
        )
        if isinstance(result, bytes):
            return result
        raise cannot_encode(result, image.shape)

    def decode(
        self, data: Buffer, shape: Iterable[int], dtype: DTypeLike, *, threads: int | None = None
    ) -> Voxels:
        """The voxels of a code, as a new C-contiguous array.

        Safe for hostile bytes: nothing is allocated before header, shape and size agree.

        Args:
            data: what `encode` returned, in any contiguous buffer.
            shape: of the encoded array, (z, y, x) or (z, y, x, 3).
            dtype: its sample type.
            threads: as in `encode`.

        Raises:
            CorruptBrickError: the bytes are not a code of this shape, type and codebook.
            InvalidInputError: a shape that no array has.
            UnsupportedError: another sample type.
        """
        expected = (*require_image_shape(shape), require_dtype(dtype).name)
        reader = self._open(data)
        found = (*reader.shape, *_channels(reader), _dtype(reader).name)
        if found != expected:
            raise CorruptBrickError(
                f"the code is of {found}, but {expected} was expected; check shape and type, or "
                "fetch the bytes again",
                expected=[str(v) for v in expected],
                found=[str(v) for v in found],
            )
        return self._level(reader, 0, threads)

    def decode_level(self, data: Buffer, level: int, *, threads: int | None = None) -> Voxels:
        """The volume at level 0 (all), 1 (averages of 2³ voxels) or 2 (averages of cells).

        Level l has ceil(n / 2^l) voxels along each axis. Levels 1 and 2 are read from averages
        and details of level 0, without decoding the rest.

        Raises:
            CorruptBrickError: the bytes are not a code with this codebook.
            InvalidInputError: another level.
        """
        if level not in (0, 1, 2):
            raise InvalidInputError(f"level is {level}; a zerobit code has levels 0, 1 and 2")
        return self._level(self._open(data), level, threads)

    def decode_voxel(self, data: Buffer, zyx: Iterable[int]) -> Any:
        """One voxel: a numpy scalar, or an array (3,) for colours.

        Only the header and the voxel's unit block are looked at and checked.

        Raises:
            CorruptBrickError: these are not what `encode` writes.
            InvalidInputError: the position is outside of the volume.
        """
        reader = self._open(data)
        at = require_position(zyx, reader.shape, "voxel")
        out = np.empty(_channels(reader), _dtype(reader))
        require_sound(reader.voxel(at, out))
        return out if out.ndim else out[()]

    def decode_plane(self, data: Buffer, cell_zyx: Iterable[int], axis: int, offset: int) -> Voxels:
        """The 4×4 voxels of one cell at `offset` (0 to 3) along `axis` (0 is z, 2 is x).

        The axes that remain keep their order. Voxels outside of the volume repeat its last ones,
        more or less.

        Raises:
            CorruptBrickError, InvalidInputError: as `decode_voxel`.
        """
        if axis not in (0, 1, 2) or offset not in (0, 1, 2, 3):
            raise InvalidInputError(
                f"plane axis is {axis} and offset {offset}; give an axis 0 to 2 (z, y, x) and an "
                "offset 0 to 3"
            )
        reader = self._open(data)
        cell = require_position(cell_zyx, _cells(reader.shape), "cell")
        out = np.empty((4, 4, *_channels(reader)), _dtype(reader))
        require_sound(reader.plane(cell, axis, offset, out))
        return out

    def decode_cell(self, data: Buffer, cell_zyx: Iterable[int]) -> Voxels:
        """The 4×4×4 voxels of one cell, those outside of the volume too.

        Raises:
            CorruptBrickError, InvalidInputError: as `decode_voxel`.
        """
        reader = self._open(data)
        cell = require_position(cell_zyx, _cells(reader.shape), "cell")
        out = np.empty((4, 4, 4, *_channels(reader)), _dtype(reader))
        require_sound(reader.cell(cell, out))
        return out

    def block_thresholds(self, data: Buffer) -> NDArray[np.float32]:
        """For each unit block the largest detail that was dropped in it, as one of level 1.

        The scale of what was lost, for deblocking (which allows a change of twice as much); not a
        bound of the error. Shape ceil(n/16).

        Raises:
            CorruptBrickError: as `decode_voxel`.
        """
        reader = self._open(data)
        return np.array(reader.thresholds(), np.float32).reshape(reader.grid)

    def stats(self, data: Buffer) -> ZerobitStats:
        """What a code is made of.

        Raises:
            CorruptBrickError: the bytes are not a code with this codebook.
        """
        reader = self._open(data)
        require_sound(reader.check())
        cells, details, null0, null1 = reader.stats()
        return ZerobitStats(
            nbytes=memoryview(data).nbytes,
            pointers_nbytes=reader.pointers_nbytes,
            codebook_nbytes=reader.codebook_nbytes,
            cells=cells,
            details=details,
            null_nodes=(null0 / cells, null1 / (8 * cells)) if cells else (1.0, 1.0),
            background=tuple(reader.background[: reader.channels]),
        )

    def _settings(self, dtype: np.dtype[Any], channels: int) -> _native.ZerobitSettings:
        colour = None if self.background is None else colour_of(self.background, dtype, channels)
        return _native.ZerobitSettings(
            self.ratio,
            self.thresholds == "global",
            self.ranking == "orthonormal",
            self.count_averages,
            colour,
        )

    def _codebook_bytes(self) -> bytes:
        return b"" if self.codebook is None else self.codebook.data

    def _open(self, data: Buffer) -> _native.ZerobitReader:
        view = memoryview(data)
        if not view.c_contiguous:
            raise InvalidInputError("a code must be contiguous in memory; pass bytes(data)")
        reader = _native.ZerobitReader(view, self._codebook_bytes())
        require_sound(reader.outcome)
        return reader

    def _level(self, reader: _native.ZerobitReader, level: int, threads: int | None) -> Voxels:
        workers = thread_count(threads)
        shape = tuple(-(-n // 2**level) for n in reader.shape)
        out: Voxels = np.empty((*shape, *_channels(reader)), _dtype(reader))
        require_sound(reader.level(level, out, workers))
        return out


def _type(dtype: np.dtype[Any]) -> int:
    return SAMPLE_DTYPES.index(dtype)


def _dtype(reader: _native.ZerobitReader) -> np.dtype[Any]:
    return SAMPLE_DTYPES[reader.type]


def _channels(reader: _native.ZerobitReader) -> tuple[int, ...]:
    return () if reader.channels == 1 else (reader.channels,)


def _cells(shape: Zyx) -> Zyx:
    nz, ny, nx = shape
    return -(-nz // 4), -(-ny // 4), -(-nx // 4)
