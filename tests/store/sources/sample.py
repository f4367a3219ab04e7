"""What a writer of the contract's tests gives: a file, and the voxels that are in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

SPACING_ZYX = (2.5, 0.75, 0.5)


@dataclass(frozen=True)
class Sample:
    """A file, the voxels that are in it and what `open_source` must be told about it."""

    path: Path
    voxels: np.ndarray = field(repr=False)
    options: dict[str, Any] = field(default_factory=dict)


Writer = Callable[[Path, np.ndarray], Sample]

READ_DTYPES = (
    *("uint8", "int8", "uint16", "int16", "float32"),
    *("bool", "uint32", "int32", "uint64", "int64", "float16", "float64"),
)


def dtypes_of(writer: Writer) -> tuple[str, ...]:
    """The sample types that a writer's format can hold: its attribute ``dtypes``, or all."""
    return getattr(writer, "dtypes", READ_DTYPES)
