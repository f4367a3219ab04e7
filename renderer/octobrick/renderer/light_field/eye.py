"""Where a light field is looked at from, and on what the eye is focused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from octobrick.codec.errors import InvalidInputError

Interpolation = Literal["nearest", "st", "uvst"]
"""Between views and pixels: the nearest of both; pixels blended, of the nearest view (the paper's
st-lerp); both blended (uvst-lerp)."""
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)

FOCUS_MAX = 4096.0  # pixels from one view to the next: more than any picture has


@dataclass(frozen=True, slots=True)
class Eye:
    """An eye that looks straight at the plane of the cameras.

    Attributes:
        u: its place in that plane, in views: 0 is the first column, 2.5 between the third and
            the fourth.
        v: the same along rows.
        focus: pixels that a point in focus moves from one view to the next, to the right and
            down. 0 is the plane of the pictures. What lies there is sharp between cameras.
        spread: views that the width of the picture crosses. 0 with the eye in the plane of the
            cameras; the farther it is behind it, the more.

    Raises:
        InvalidInputError: a number that is not finite, or a spread below 0.
    """

    u: float
    v: float
    focus: float = 0.0
    spread: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value):
                raise InvalidInputError(f"eye {field.name} is {value}; give a finite number")
        if abs(self.focus) > FOCUS_MAX:
            raise InvalidInputError(
                f"eye focus is {self.focus:g} pixels a view; give -{FOCUS_MAX:g} to {FOCUS_MAX:g}"
            )
        if self.spread < 0:
            raise InvalidInputError(f"eye spread is {self.spread:g} views; give 0 or more")

    def require_within(self, nu: int, nv: int) -> None:
        """Refuse an eye beside the cameras, or a spread that leaves them on both sides.

        Raises:
            InvalidInputError: naming the range.
        """
        if not (0 <= self.u <= nu - 1 and 0 <= self.v <= nv - 1):
            raise InvalidInputError(
                f"eye (u, v) = ({self.u:g}, {self.v:g}) is outside of the cameras, which stand at "
                f"0 to {nu - 1} along u and 0 to {nv - 1} along v",
                u=self.u,
                v=self.v,
                u_max=nu - 1,
                v_max=nv - 1,
            )
        widest = 2 * max(nu - 1, nv - 1)
        if self.spread > widest:
            raise InvalidInputError(
                f"eye spread is {self.spread:g} views; with {nu} × {nv} views (u × v) give 0 to "
                f"{widest}",
                spread=self.spread,
            )

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def eye_path(eyes: Sequence[Eye], nframes: int) -> list[Eye]:
    """Eyes on the straight lines from each of the given to the next, evenly in time.

    Args:
        eyes: two or more, of which the path has the first and the last.
        nframes: two or more.

    Raises:
        InvalidInputError: fewer.
    """
    if len(eyes) < 2 or nframes < 2:
        raise InvalidInputError(
            f"a path of {nframes} frames through {len(eyes)} eyes: give two or more of each"
        )
    path = []
    for index in range(nframes):
        # In whole numbers, so that given eyes are met exactly.
        leg, rest = divmod(index * (len(eyes) - 1), nframes - 1)
        if rest == 0:
            path.append(eyes[leg])
            continue
        share = rest / (nframes - 1)
        ends = (eyes[leg].to_dict(), eyes[leg + 1].to_dict())
        path.append(Eye(**{n: ends[0][n] + share * (ends[1][n] - ends[0][n]) for n in ends[0]}))
    return path
