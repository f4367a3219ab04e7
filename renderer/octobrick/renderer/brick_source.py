"""What the renderer needs of a volume, and nothing more.

`octobrick.store.Volume` satisfies `BrickSource`; so does a client that fetches bricks over HTTP,
and so does the in-memory source of the tests. The renderer never imports any of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from octobrick.store.box import Zyx

Xyz = tuple[float, float, float]


@runtime_checkable
class BlockCode(Protocol):
    """S3Dc at a fixed rate with a linear scale, by the parameters that fix a brick's bytes.

    `octobrick.codec.S3dc` is one; a source that does not have it may give its own. All other codes
    are known by their codec, `S3dc` or `octobrick.codec.Zerobit`.
    """

    @property
    def block(self) -> tuple[int, int, int]:
        """Voxels of a block along (z, y, x)."""

    @property
    def bits(self) -> int | None:
        """Bits of an index, 1 to 8; None where every block has its own."""

    @property
    def scale(self) -> str:
        """How indices lie between end points: "linear"."""


class SourceLevel(Protocol):
    """One resolution of the pyramid and where it lies in the world."""

    @property
    def shape_zyx(self) -> Zyx:
        """Voxels along each axis, without the padding of edge bricks."""

    @property
    def grid_zyx(self) -> Zyx:
        """Bricks along each axis."""

    @property
    def spacing_xyz(self) -> Xyz:
        """World units from one voxel centre to the next."""

    @property
    def origin_xyz(self) -> Xyz:
        """World position of the centre of voxel (0, 0, 0)."""


class BrickSource(Protocol):
    """A volume as the renderer sees it: geometry, summaries per brick, and bricks as bytes.

    Bricks are addressed by (level, (z, y, x), t, c). All have the full brick shape; those at the
    edge are padded by repeating the last voxel. The bytes of an address never change while
    `revision` stays the same, so the renderer keeps them between frames.
    """

    @property
    def levels(self) -> Sequence[SourceLevel]:
        """The pyramid, finest first."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """uint8, int8, uint16, int16 or float32."""

    @property
    def brick_shape_zyx(self) -> Zyx:
        """Voxels of a brick along each axis."""

    @property
    def nt(self) -> int:
        """Time steps."""

    @property
    def nc(self) -> int:
        """Channels."""

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest original voxel of level 0; no decoded voxel lies outside."""

    @property
    def window(self) -> tuple[float, float]:
        """The values that a display spreads over its contrast, unless told otherwise."""

    @property
    def fill_value(self) -> float:
        """The value of every voxel of a brick that is absent."""

    @property
    def revision(self) -> str:
        """Changes whenever any brick's bytes do."""

    def level_codec(self, level: int) -> object:
        """The codec of a level's bricks; None where these are raw little-endian voxels.

        `octobrick.codec.S3dc`, `octobrick.codec.Zerobit` or a `BlockCode`. Of anything else the
        volume has a method ``brick`` that gives decoded voxels.
        """

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """The codec's code or raw voxels, ready for upload; None for an absent brick."""

    def ranges(self, level: int, t: int = 0, c: int = 0) -> NDArray[Any]:
        """Minimum and maximum per brick, one voxel wider than the brick: (nz, ny, nx, 2)."""

    def fidelity(self, level: int, t: int = 0, c: int = 0) -> NDArray[Any]:
        """Largest error and RMSE per brick of decoded against original: (nz, ny, nx, 2)."""


class BrickBatch(Protocol):
    """Many bricks of one source on their way, in the order asked for but for those at hand."""

    def __iter__(self) -> Iterator[tuple[int, bytes | Exception | None]]:
        """Place in the list and code, or the error of that brick alone, each once it is here."""

    def close(self) -> None:
        """Give no more. From any thread; wakes the one that waits, and never waits itself."""


@runtime_checkable
class BatchSource(Protocol):
    """What a source, of voxels or of directions, has where many bricks at once come faster."""

    def brick_codes(self, places: Sequence[tuple[int, Zyx, int, int]]) -> BrickBatch:
        """The codes of bricks by (level, (z, y, x), t, c), most urgent first."""


class GradientSource(Protocol):
    """The directions of a volume's gradients: `octobrick.store.StoredGradients`, or alike."""

    @property
    def levels(self) -> Sequence[int]:
        """Those that have directions."""

    @property
    def brick_shape_zyx(self) -> Zyx:
        """Voxels of a brick along each axis, those of the volume's."""

    def code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """Three bytes a voxel, x fastest; None where no voxel of the brick has a direction."""
