"""One line of the stress report, as a value."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class StressRow:
    """A promise, and the range of one parameter in which it was seen to hold.

    Attributes:
        system: "S3Dc", "S3Dc, bounded", "zerobit", "gradients", "deblocking" or "renderer".
        implementation: "C++" or the OpenGL device.
        parameter: what was varied, with its unit.
        promise: a sentence.
        tolerance: what the worst value was compared with, in the promise's unit.
        tested: least and greatest parameter that were tried; None where nothing was.
        held: the widest stretch of them, from where the search began, in which the promise held at
            every value that was tried; None where it did not hold where the search began.
        worst: greatest value within `held`; at most the tolerance.
        worst_at: the parameter there.
        first_failure: the first parameter outside of `held` that broke the promise, and how; None
            where none did.
        ntried: values that were tried.
        note: why nothing was run; empty otherwise.
    """

    system: str
    implementation: str
    parameter: str
    promise: str
    tolerance: float
    tested: tuple[float, float] | None
    held: tuple[float, float] | None
    worst: float | None
    worst_at: float | None
    first_failure: str | None
    ntried: int
    note: str = ""

    @property
    def ok(self) -> bool:
        """Whether the promise held at all that was tried."""
        return self.tested is not None and self.first_failure is None

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values: no NaN or infinity."""
        return {name: _plain(value) for name, value in asdict(self).items()}


def _plain(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return [_plain(v) for v in value] if isinstance(value, tuple) else value
