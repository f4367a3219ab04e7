"""The bricks of one level as bytes: what they are, and the one way by which a pool gets them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from octobrick.renderer.brick_request import BrickAddress, BrickRequest, Kind
from octobrick.renderer.brick_source import BrickSource, GradientSource
from octobrick.renderer.code_check import checked_code
from octobrick.renderer.code_layout import CodeLayout
from octobrick.store.box import Zyx

LevelAddress = tuple[Kind, str, int, int, int]
"""(what, revision, level, t, c): with a brick's position it never changes its bytes."""


@dataclass(frozen=True, slots=True)
class BrickCodes:
    """Where the bytes of a level's bricks come from.

    Attributes:
        address: of all these bricks.
        layout: how their bytes lie.
        read: the bytes of a brick as they are stored; None for an absent one. A loader that has
            fetched them before may stand here.
    """

    address: LevelAddress
    layout: CodeLayout
    read: Callable[[Zyx], bytes | None]

    @classmethod
    def of_voxels(cls, source: BrickSource, level: int, t: int, c: int) -> BrickCodes:
        """The voxels of a volume.

        Raises:
            UnsupportedError: a sample type or a codec that the GPU does not decode.
        """
        return cls(
            ("voxels", source.revision, level, t, c),
            CodeLayout.of(source, level),
            lambda zyx: source.brick_code(level, zyx, t, c),
        )

    @classmethod
    def of_directions(
        cls, source: GradientSource, revision: str, level: int, t: int, c: int
    ) -> BrickCodes:
        """The directions of a volume's gradients."""
        return cls(
            ("directions", revision, level, t, c),
            CodeLayout("directions", "uint8", source.brick_shape_zyx),
            lambda zyx: source.code(level, zyx, t, c),
        )

    def taken_by(self, take: Callable[[BrickRequest], bytes | None], source: Any) -> BrickCodes:
        """The same bricks, got through something that reads them ahead."""

        def read(zyx: Zyx) -> bytes | None:
            return take(self.request(zyx, source))

        return replace(self, read=read)

    def request(self, zyx: Zyx, source: Any) -> BrickRequest:
        """What a loader takes to read a brick from the source that these bricks are of."""
        kind, revision, level, t, c = self.address
        return BrickRequest(BrickAddress(revision, kind, level, t, c, zyx), source)

    def upload(self, zyx: Zyx) -> bytes | None:
        """The bytes of a brick as decoders take them; None for an absent one.

        Raises:
            CorruptBrickError: they are not a code of this layout; naming the brick.
        """
        code = self.read(zyx)
        if code is None:
            return None
        what, _, level, _, _ = self.address
        name = f"brick {zyx} of level {level}" + (f" ({what})" if what != "voxels" else "")
        return checked_code(self.layout, code, name, level, zyx)
