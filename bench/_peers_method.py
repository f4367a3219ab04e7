"""What a method of coding must do to be compared with others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import zstandard
from numpy.typing import NDArray

Voxels = NDArray[Any]

Access = Literal["voxel", "block 4³", "chunk", "brick 64³", "no"]
"""What must be decoded to know one voxel; "no": everything, from the beginning on."""

RESIDENT_ACCESS = ("voxel", "block 4³")
"""Codes that a renderer can sample as they are. The others are held decoded."""


class NotRunError(Exception):
    """A method could not be tried on this machine; says what to install."""


class NotPossibleError(Exception):
    """A method has no code for such voxels; says why."""


class Calls(Protocol):
    """One method, ready for one volume; the first two are what is timed."""

    def encode(self) -> Any:
        """The code."""

    def decode(self, code: Any) -> Any:
        """All voxels, as the method's own program gives them."""

    def voxels(self, decoded: Any) -> Voxels:
        """These as an array like the original; not timed."""

    def sizes(self, code: Any) -> tuple[int, int]:
        """Bytes of the code as it is sampled, and on disk."""


class Method(NamedTuple):
    """A way of coding with its parameters.

    Attributes:
        name: of the row.
        family: methods of one family differ in one parameter.
        access: what must be decoded for one voxel.
        ready: makes the calls for a volume, with an empty folder for files; not timed.
        is_slow: whether the time of one whole run must do.
    """

    name: str
    family: str
    access: Access
    ready: Callable[[Voxels, Path], Calls]
    is_slow: bool = False

    @property
    def is_ours(self) -> bool:
        """Whether octobrick has it."""
        return self.family.startswith(OURS)


OURS = ("S3Dc", "zerobit", "octobrick")


def behind_zstd(code: bytes | memoryview) -> int:
    """Bytes of a code behind zstd at level 3."""
    return len(zstandard.ZstdCompressor(level=3).compress(code))


def value_range(voxels: Voxels) -> float:
    """Greatest less least."""
    return float(voxels.max()) - float(voxels.min())


def contiguous(voxels: Voxels) -> Voxels:
    """C-contiguous, in the machine's byte order."""
    return np.ascontiguousarray(voxels, voxels.dtype.newbyteorder("="))
