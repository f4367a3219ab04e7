"""The C++ codec. Internal: use octobrick.codec."""

import enum
from collections.abc import Sequence

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

    BAD_WIDTHS = 9

    BUDGET_TOO_SMALL = 10

    WRONG_PREDICTION = 11

    BAD_GROUPS = 12

    BAD_RAW = 13

    BAD_SCALES = 14

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
    shape: tuple[int, int, int],
    sample_nbytes: int,
    block: tuple[int, int, int],
    bits: int,
    scaled: bool = False,
) -> Outcome | tuple[int, int]:
    """Bytes of the end points and of the whole code, or what is wrong."""

def encode(
    array: object,
    block: tuple[int, int, int],
    bits: int,
    threads: int = 0,
    simd: bool = True,
    fitted: bool = False,
    scaled: bool = False,
) -> Outcome | bytes:
    """The code of an array (z, y, x), or what is wrong with it."""

def decode_into(
    data: object,
    out: object,
    block: tuple[int, int, int],
    bits: int,
    threads: int = 0,
    simd: bool = True,
    scaled: bool = False,
) -> Outcome:
    """Decode into an array (z, y, x) of the voxels' shape and type."""

def mean2_into(fine: object, coarse: object, threads: int = 0, simd: bool = True) -> bool:
    """Reduce to half the shape, rounded up; False where they do not fit."""

def upsample2_into(coarse: object, fine: object, threads: int = 0, simd: bool = True) -> bool:
    """Interpolate to twice the shape; False where they do not fit."""

def compare(a: object, b: object, simd: bool = True) -> tuple[int, float, float]:
    """Count, max |a - b|, sum of (a - b)^2; whole for integer arrays."""

def count_values_into(
    array: object, exponent: int, first: int, counts: object, simd: bool = True
) -> bool:
    """Add the voxels to bins; False where one has no bin."""

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
    whole: tuple[float, float],
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

def reduced_differences_into(
    volume: object,
    start: tuple[int, int, int],
    shape: tuple[int, int, int],
    spacing_zyx: tuple[float, float, float],
    coarse: object,
    threads: int = 0,
    simd: bool = True,
) -> int | None:
    """The reduced gradient of a part; the first that is not finite, or None."""

def encode_directions_into(
    vectors: object, codes: object, threads: int = 0, simd: bool = True
) -> int | None:
    """The codes of vectors; the first that is not finite, or None."""

def decode_directions_into(
    codes: object, vectors: object, threads: int = 0, simd: bool = True
) -> None:
    """The unit vectors of codes."""

class WidthRule(enum.Enum):
    """How widths are chosen; see s3dc_variable.h."""

    SAME = 0

    BOUND = 1

    BUDGET = 2

    SLOPE = 3

def variable_encode(
    array: object,
    block: tuple[int, int, int],
    rule: WidthRule,
    value: float,
    fitted: bool,
    prediction: object | None,
    threads: int = 0,
    simd: bool = True,
) -> Outcome | bytes:
    """The code of an array (z, y, x), or what is wrong with it."""

def variable_decode_into(
    data: object,
    out: object,
    block: tuple[int, int, int],
    prediction: object | None,
    threads: int = 0,
    simd: bool = True,
) -> Outcome:
    """Decode into an array (z, y, x) of the voxels' shape and type."""

def variable_layout(
    shape: tuple[int, int, int], sample_nbytes: int, block: tuple[int, int, int], predicted: bool
) -> Outcome | tuple[int, int, int, int]:
    """Where groups, flags and payload begin; bytes of a unit; or a fault."""

class SlopeFinder:
    """One slope for many volumes; see s3dc_variable.h."""

    def __init__(self, block: tuple[int, int, int], fitted: bool, sample_type: int) -> None: ...
    def add(self, array: object, prediction: object | None, threads: int = 0) -> Outcome: ...
    def slope(self, bits_per_voxel: float) -> float: ...

class Sampling(enum.Enum):
    """How a point is sampled; see s3dc_sampler.h."""

    NEAREST = 0

    TRILINEAR = 1

    TRILINEAR_SHARED = 2

class S3dcSampler:
    """Samples a code; see octobrick/codec/s3dc_sampler.h."""

    def __init__(
        self,
        code: object,
        shape: tuple[int, int, int],
        sample_type: int,
        block: tuple[int, int, int],
        bits: int | None,
        simd: bool = True,
    ) -> None: ...
    @property
    def outcome(self) -> Outcome: ...
    def sample(self, how: Sampling, points: object, out: object) -> None: ...
    def gradient(
        self, how: Sampling, points: object, spacing_zyx: tuple[float, float, float], out: object
    ) -> None: ...
    def count_fetches(self, how: Sampling, points: object) -> tuple[int, int]:
        """Pairs of end points, and words of indices."""

class ZerobitStatus(enum.Enum):
    """How a call ended; see octobrick/codec/zerobit.h."""

    OK = 0

    UNSUPPORTED_TYPE = 1

    EMPTY_SHAPE = 2

    TOO_LARGE = 3

    NOT_FINITE = 4

    WRONG_CODEBOOK = 5

    BAD_HEADER = 6

    WRONG_NBYTES = 7

    BAD_BLOCK = 8

class ZerobitOutcome:
    """A status, where, and what it is about."""

    @property
    def status(self) -> ZerobitStatus: ...
    @property
    def at(self) -> tuple[int, int, int]: ...
    @property
    def first(self) -> float: ...
    @property
    def second(self) -> float: ...

class ZerobitSettings:
    """What an encoder keeps."""

    def __init__(
        self,
        ratio: float,
        global_threshold: bool,
        orthonormal: bool,
        count_averages: bool,
        background: Sequence[float] | None,
    ) -> None: ...

class ZerobitTrainer:
    """Gathers colours for a shared codebook."""

    def __init__(self, sample_type: int, channels: int, settings: ZerobitSettings) -> None: ...
    def add(
        self,
        voxels: object,
        shape: tuple[int, int, int],
        sample_type: int,
        channels: int,
        threads: int = 0,
    ) -> ZerobitOutcome: ...
    def codebook(self) -> bytes: ...

def zerobit_encode(
    voxels: object,
    shape: tuple[int, int, int],
    sample_type: int,
    channels: int,
    settings: ZerobitSettings,
    wanted: object,
    codebook: object,
    threads: int = 0,
) -> ZerobitOutcome | bytes:
    """The code of a C-contiguous array, or what is wrong with it."""

class ZerobitReader:
    """Reads a code; see octobrick/codec/zerobit.h."""

    def __init__(self, code: object, codebook: object) -> None: ...
    @property
    def outcome(self) -> ZerobitOutcome: ...
    @property
    def shape(self) -> tuple[int, int, int]: ...
    @property
    def grid(self) -> tuple[int, int, int]: ...
    @property
    def type(self) -> int: ...
    @property
    def channels(self) -> int: ...
    @property
    def background(self) -> list[float]: ...
    @property
    def pointers_nbytes(self) -> int: ...
    @property
    def codebook_nbytes(self) -> int: ...
    def check(self, threads: int = 0) -> ZerobitOutcome: ...
    def level(self, level: int, out: object, threads: int = 0) -> ZerobitOutcome: ...
    def voxel(self, at: tuple[int, int, int], out: object) -> ZerobitOutcome: ...
    def voxels(self, at: object, out: object) -> ZerobitOutcome:
        """Of many positions, uint64 (n, 3)."""

    def cells(self, at: object, out: object) -> ZerobitOutcome:
        """Of many cells, uint64 (n, 3)."""

    def plane(
        self, cell: tuple[int, int, int], axis: int, offset: int, out: object
    ) -> ZerobitOutcome: ...
    def cell(self, cell: tuple[int, int, int], out: object) -> ZerobitOutcome: ...
    def thresholds(self) -> list[float]: ...
    def stats(self) -> tuple[int, int, int, int]: ...

def zerobit_voxel_operations(z: int, y: int, x: int) -> tuple[int, int]:
    """Additions and decodings of one voxel."""

def zerobit_plane_operations(axis: int, offset: int) -> tuple[int, int]:
    """Additions and decodings of one plane of a cell."""

def zerobit_cell_operations() -> tuple[int, int]:
    """Additions and decodings of one cell."""
