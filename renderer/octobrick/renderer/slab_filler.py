"""What fills slabs with voxels: one promise that the GPU keeps and, where it is faster, the CPU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from octobrick.renderer.brick_request import BrickAddress
from octobrick.renderer.brick_source import BrickSource, GradientSource
from octobrick.store.box import Box, Zyx

if TYPE_CHECKING:
    from octobrick.renderer.slab_buffer import SlabBuffer


@dataclass(frozen=True, slots=True)
class SlabContent:
    """Which voxels a slab buffer is to hold.

    Attributes:
        revision: of the volume.
        level: of the pyramid.
        t: time step.
        c: channel.
        box: voxels of the level, margins included.
        deblocking: strength of the deblocking filter; None leaves voxels as they are decoded.
    """

    revision: str
    level: int
    t: int
    c: int
    box: Box
    deblocking: float | None = None


@dataclass(slots=True)
class Filled:
    """What filling a slab took; adds up over slabs.

    Attributes:
        nvoxels: decoded; 0 where the slab still held them.
        nbricks: decoded.
        nabsent: of them, bricks that have no bytes: all of their voxels have the fill value.
        nsubstituted: bricks that are not there yet, shown by coarser ones meanwhile.
        nlevels_up: how much coarser the coarsest of those is.
    """

    nvoxels: int = 0
    nbricks: int = 0
    nabsent: int = 0
    nsubstituted: int = 0
    nlevels_up: int = 0

    def add(self, other: Filled) -> None:
        """Count another slab's too."""
        self.nvoxels += other.nvoxels
        self.nbricks += other.nbricks
        self.nabsent += other.nabsent
        self.nsubstituted += other.nsubstituted
        self.nlevels_up = max(self.nlevels_up, other.nlevels_up)


class SlabFiller(Protocol):
    """Keeps bricks compressed under a byte budget and decodes them into slab buffers."""

    waits: bool
    """Whether bricks are waited for. Else coarser ones stand for those that are not there."""

    def holds(self, address: BrickAddress) -> bool:
        """Whether a brick is here."""

    def fill(
        self, source: BrickSource, slab: SlabBuffer, content: SlabContent, bricks: Sequence[Zyx]
    ) -> Filled:
        """Make the slab hold the content's voxels that lie in these bricks.

        What it holds elsewhere has no meaning. A slab that has all of them already is left alone.

        Raises:
            CorruptBrickError: a brick is damaged.
            ResourceError: the budget does not hold a single brick.
        """

    def fill_directions(
        self,
        gradients: GradientSource,
        slab: SlabBuffer,
        content: SlabContent,
        bricks: Sequence[Zyx],
    ) -> Filled:
        """The same for the codes of gradient directions, in a slab of the format DIRECTIONS.

        Raises:
            CorruptBrickError, ResourceError: as `fill`.
        """

    @property
    def uploaded_nbytes(self) -> int:
        """Bytes taken in from volumes since the filler was made."""

    @property
    def resident_nbytes(self) -> int:
        """Bytes of compressed bricks that are held, without empty slots."""

    @property
    def allocated_nbytes(self) -> int:
        """Memory taken, never above the budget."""

    def forget(self) -> None:
        """Let go of all bricks."""
