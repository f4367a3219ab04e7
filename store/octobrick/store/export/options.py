"""What a caller chooses about a format."""

from __future__ import annotations

import math
from dataclasses import dataclass

from octobrick.codec.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class WriterOptions:
    """Choices that some formats take; checked when made.

    Attributes:
        compress: whether voxels are compressed, where plain ones are the rule.
        active: lowest and highest value of the voxels that a sparse format keeps; None keeps all.

    Raises:
        InvalidInputError: an active range that holds nothing.
    """

    compress: bool = False
    active: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.active is None:
            return
        low, high = self.active
        if math.isnan(low) or math.isnan(high) or low > high:
            raise InvalidInputError(
                f"active values from {low:g} to {high:g} are none; give the lowest, then the "
                "highest (infinite ends are allowed)",
                active=[str(low), str(high)],
            )
