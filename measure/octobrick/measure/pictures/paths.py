"""Ways to draw one volume, each with what the renderer and the command line call it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from octobrick.codec import S3dc
from octobrick.renderer.direct_bricks import SAMPLINGS
from octobrick.renderer.render_request import DEBLOCKING_STRENGTH
from octobrick.store.brick_codec import BrickCodec

LEVELS: Final = 3
"""Levels 0, 1 and 2 are drawn: two steps of the trade, and beyond them a picture is a sketch."""


@dataclass(frozen=True, slots=True)
class RenderPath:
    """One way to draw.

    Attributes:
        name: for people: "direct, linear".
        level: of the pyramid.
        arguments: of `Renderer.render`, beside camera, transfer function, size, window and step.
        flags: of `octobrick render`, which draw so.
    """

    name: str
    level: int = 0
    arguments: dict[str, Any] = field(default_factory=dict, hash=False)
    flags: tuple[str, ...] = ()

    def applies_to(self, codec: BrickCodec) -> bool:
        """Whether bricks of a codec can be drawn so, and another picture may come of it."""
        if "direct" in self.arguments:
            return isinstance(codec, S3dc) and not codec.variable and codec.scale == "linear"
        return "deblocking" not in self.arguments or codec is not None


SLAB: Final = RenderPath("slab", 0, {"level": 0}, ("--level", "0"))
"""The reference, where bricks are lossless: level 0, lit by differences, not deblocked."""

DEBLOCKED: Final = RenderPath(
    "slab, deblocked",
    0,
    {"level": 0, "deblocking": DEBLOCKING_STRENGTH},
    ("--level", "0", "--deblock", f"{DEBLOCKING_STRENGTH:g}"),
)

DIRECT: Final = tuple(
    RenderPath(
        f"direct, {sampling}",
        0,
        {"level": 0, "direct": sampling},
        ("--level", "0", "--direct", sampling),
    )
    for sampling in SAMPLINGS
)


def coarser_paths(nlevels: int) -> Iterator[RenderPath]:
    """Levels from 1 on that a volume has, lit by the stored pyramid and by what is shown."""
    for level in range(1, min(nlevels, LEVELS)):
        for source, name in (("stored", "stored gradients"), ("differences", "differences")):
            yield RenderPath(
                f"level {level}, {name}",
                level,
                {"level": level, "gradients": source},
                ("--level", str(level), "--gradients", source),
            )
