"""What a caller may say of a measurement, checked before anything is read."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import DTypeLike

from octobrick.codec.errors import InvalidInputError
from octobrick.measure.settings import number
from octobrick.measure.target import Target
from octobrick.store import Zyx

_SIDE_MIN, _SIDE_MAX = 16, 2048  # of a picture, in pixels
_SECONDS_MAX = 7 * 24 * 3600.0


@dataclass(frozen=True, slots=True)
class SourceOptions:
    """How a source is read, and stored: those options of `octobrick.store.ingest` that say it."""

    shape: Zyx | None = None
    dtype: DTypeLike | None = None
    spacing: tuple[float, float, float] | None = None
    offset: int = 0
    big_endian: bool = False
    dataset: str | None = None
    axes: str | None = None
    labels: bool | None = None
    convert: str | None = None
    window: tuple[float, float] | None = None
    replace_nonfinite: float | None = None

    def flags(self) -> list[str]:
        """The same for `octobrick ingest`."""
        words: list[str] = []
        for name in ("dataset", "axes", "convert"):
            if getattr(self, name) is not None:
                words += [f"--{name}", str(getattr(self, name))]
        if self.dtype is not None:
            words += ["--dtype", str(self.dtype)]
        for name in ("shape", "spacing", "window"):
            values = getattr(self, name)
            if values is not None:
                # As one word, since a value may begin with a minus sign.
                words.append(f"--{name}={','.join(map(number, values))}")
        if self.offset:
            words += ["--offset", str(self.offset)]
        if self.big_endian:
            words.append("--big-endian")
        if self.labels is not None:
            words.append("--labels" if self.labels else "--no-labels")
        if self.replace_nonfinite is not None:
            words.append(f"--replace-nonfinite={number(self.replace_nonfinite)}")
        return words

    def given(self) -> list[str]:
        """The flags that only a source in a foreign format takes."""
        return [word.split("=")[0] for word in self.flags() if word.startswith("--")]


@dataclass(frozen=True, slots=True)
class MeasureOptions:
    """The options of `measure` beside those of the source.

    Raises:
        InvalidInputError: naming the option, its value and what it may be.
    """

    targets: tuple[Target, ...]
    full: bool
    seconds: float
    seed: int
    views: tuple[tuple[float, float], ...]
    size: tuple[int, int]
    preset: str | None
    pictures: bool
    workers: int

    def __post_init__(self) -> None:
        if not 0 < self.seconds <= _SECONDS_MAX:
            raise InvalidInputError(
                f"seconds {self.seconds}: must be above 0, and at most a week", seconds=self.seconds
            )
        if self.seed < 0:
            raise InvalidInputError(f"seed {self.seed}: must be 0 or more", seed=self.seed)
        for azimuth, elevation in self.views:
            if not (math.isfinite(azimuth) and -90 <= elevation <= 90):
                raise InvalidInputError(
                    f"view {azimuth},{elevation}: must be an azimuth in degrees and an elevation "
                    "from -90 to 90"
                )
        if any(not _SIDE_MIN <= n <= _SIDE_MAX for n in self.size):
            raise InvalidInputError(
                f"size {self.size[0]}x{self.size[1]}: each side must be {_SIDE_MIN} to {_SIDE_MAX}"
            )

    @classmethod
    def of(cls, targets: Sequence[str], **given: Any) -> MeasureOptions:
        """With targets as they are written, and as many workers as there are processors."""
        parsed = tuple(Target.parse(text) for text in targets)
        return cls(targets=parsed, workers=len(os.sched_getaffinity(0)), **given)

    def to_dict(self) -> dict[str, Any]:
        """What it takes to measure again."""
        return {
            "targets": [str(target) for target in self.targets],
            "full": self.full,
            "seconds": self.seconds,
            "seed": self.seed,
            "views": [list(view) for view in self.views],
            "size": list(self.size),
            "preset": self.preset,
            "pictures": self.pictures,
        }
