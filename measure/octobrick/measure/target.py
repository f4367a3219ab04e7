"""What a user wants of a volume, in one number."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from octobrick.codec.errors import InvalidInputError

Kind = Literal["psnr", "max-error", "ratio", "bits", "fps"]
KINDS: tuple[Kind, ...] = get_args(Kind)

_RATIO_LEAST = 1.0


@dataclass(frozen=True, slots=True)
class Target:
    """A target of one kind.

    Args:
        kind: "psnr", in dB over the range of the volume; "max-error", in values, never exceeded;
            "ratio", bytes of the voxels over bytes on disk; "bits", of a voxel's code in memory,
            at most; "fps", frames a second, at least.
        value: above 0; a max-error may be 0, a ratio is at least 1.

    Raises:
        InvalidInputError: another value.
    """

    kind: Kind
    value: float

    def __post_init__(self) -> None:
        least = _RATIO_LEAST if self.kind == "ratio" else 0.0
        sound = math.isfinite(self.value) and self.value >= least
        if self.kind not in ("ratio", "max-error"):
            sound = sound and self.value > 0
        if not sound:
            bound = {"ratio": "1 or more", "max-error": "0 or more"}.get(self.kind, "above 0")
            raise InvalidInputError(
                f"target {self.kind}={self.value:g}: must be a number, {bound}", target=self.kind
            )

    @classmethod
    def parse(cls, text: str) -> Target:
        """The target that is written ``psnr=45``.

        Raises:
            InvalidInputError: it is written otherwise, or has a value that makes no sense.
        """
        name, equals, number = text.partition("=")
        kind = next((kind for kind in KINDS if kind == name.strip()), None)
        try:
            if kind is None or not equals:
                raise ValueError
            value = float(number)
        except ValueError:
            raise InvalidInputError(
                f"target {text!r:.60}: give one of {', '.join(f'{kind}=…' for kind in KINDS)}, "
                "such as psnr=45",
                target=text[:60],
            ) from None
        return cls(kind, value)

    def __str__(self) -> str:
        return f"{self.kind}={self.value:g}"
