"""The C++ codec. Internal: use octobrick.codec."""

import enum

class Status(enum.Enum):
    """How a call ended; see octobrick/codec/s3dc.h."""

    OK = 0

    BAD_BITS = 1

    BAD_BLOCK = 2

    EMPTY_SHAPE = 3

    TOO_LARGE = 4

    WRONG_NBYTES = 5

    NOT_FINITE = 6

    BAD_END_POINTS = 7

    BAD_PADDING = 8

class Outcome:
    """A status, where, and the two values that it is about."""

    @property
    def status(self) -> Status: ...
    @property
    def at(self) -> tuple[int, int, int]: ...
    @property
    def first(self) -> float: ...
    @property
    def second(self) -> float: ...

def layout_nbytes(
    shape: tuple[int, int, int], sample_nbytes: int, block: tuple[int, int, int], bits: int
) -> Outcome | tuple[int, int]:
    """Bytes of the end points and of the whole code, or what is wrong."""

def encode(
    array: object, block: tuple[int, int, int], bits: int, threads: int = 0, simd: bool = True
) -> Outcome | bytes:
    """The code of an array (z, y, x), or what is wrong with it."""

def decode_into(
    data: object,
    out: object,
    block: tuple[int, int, int],
    bits: int,
    threads: int = 0,
    simd: bool = True,
) -> Outcome:
    """Decode into an array (z, y, x) of the voxels' shape and type."""

def mean2_into(fine: object, coarse: object, threads: int = 0, simd: bool = True) -> bool:
    """Reduce to half the shape, rounded up; False where they do not fit."""

def compare(a: object, b: object, simd: bool = True) -> tuple[int, float, float]:
    """Count, max |a - b|, sum of (a - b)^2; whole for integer arrays."""

class DeblockLimit(enum.Enum):
    """How a bound limits a change; see deblock.h."""

    AUTO = 0

    RAMP = 1

    CLAMP = 2

def deblock_into(
    volume: object,
    out: object,
    block: tuple[int, int, int],
    strength: float,
    value_range: float,
    bounds: object | None,
    sequential: bool,
    limit: DeblockLimit,
    threads: int = 0,
    simd: bool = True,
) -> int | None:
    """The filtered volume; the first voxel that is not finite, or None."""

MAX_REDUCE_RADIUS: int = 16

def central_differences_into(
    volume: object, spacing_zyx: tuple[float, float, float], gradient: object, threads: int = 0
) -> int | None:
    """The gradient of a volume; the first voxel that is not finite, or None."""

def reduce_gradient_into(
    fine: object, coarse: object, radius: int, sigma: float, threads: int = 0
) -> None:
    """The gradient at half resolution."""

def encode_directions_into(
    vectors: object, codes: object, threads: int = 0, simd: bool = True
) -> int | None:
    """The codes of vectors; the first that is not finite, or None."""

def decode_directions_into(
    codes: object, vectors: object, threads: int = 0, simd: bool = True
) -> None:
    """The unit vectors of codes."""
