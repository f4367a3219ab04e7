"""OpenVDB grids: read as sparse trees, written from boxes of voxels."""

class DamagedError(RuntimeError):
    pass

class TruncatedError(EOFError):
    pass

class UnsupportedError(ValueError):
    pass

class Transform:
    """world = index · linear + translation, in x, y, z."""

    @property
    def kind(self) -> str: ...
    @property
    def is_linear(self) -> bool: ...
    @property
    def linear(self) -> list[list[float]]: ...
    @property
    def translation(self) -> list[float]: ...

class GridInfo:
    """What a file says of a grid before its voxels."""

    @property
    def name(self) -> str: ...
    @property
    def value_type(self) -> str: ...
    @property
    def sample_type(self) -> str | None: ...
    @property
    def is_half(self) -> bool: ...
    @property
    def grid_class(self) -> str: ...
    @property
    def instance_of(self) -> str: ...
    @property
    def transform(self) -> Transform: ...
    @property
    def active_min_xyz(self) -> list[int] | None: ...
    @property
    def active_max_xyz(self) -> list[int] | None: ...
    @property
    def active_voxels(self) -> int | None: ...

class File:
    """The grids of a file, in the order of the file."""

    @property
    def grids(self) -> list[GridInfo]: ...

def list_grids(path: str) -> File:
    """What a file says of its grids; no voxel is read."""

class Grid:
    """One grid in memory, as a sparse tree; any thread may read."""

    @property
    def sample_type(self) -> str: ...
    @property
    def components(self) -> int: ...
    @property
    def active_voxels(self) -> int: ...
    @property
    def leaves(self) -> int: ...
    @property
    def memory_nbytes(self) -> int: ...
    def background(self, component: int = 0) -> float: ...
    def active_box(self) -> tuple[list[int], list[int]] | None:
        """Start and shape (x, y, z) of the box of all active voxels."""

    def fill(self, out: object, start_xyz: tuple[int, int, int], component: int = 0) -> None:
        """Writes the box that begins at an index into an array [z, y, x]."""

    def constant(
        self, start_xyz: tuple[int, int, int], shape_xyz: tuple[int, int, int], component: int = 0
    ) -> float | None:
        """The value of all voxels of a box that meets no leaf and has one value."""

def load_grid(path: str, file: File, index: int) -> Grid:
    """Reads one grid of a file."""

class Writer:
    """Makes a grid of boxes of voxels; one thread at a time."""

    def __init__(self, sample_type: str, background: float) -> None: ...
    @property
    def active_voxels(self) -> int: ...
    def add(
        self, voxels: object, start_xyz: tuple[int, int, int], active: tuple[float, float] | None
    ) -> None:
        """Takes over the voxels of an array [z, y, x] from low to high, or all."""

    def save(
        self,
        path: str,
        name: str,
        grid_class: str,
        spacing_xyz: tuple[float, float, float],
        origin_xyz: tuple[float, float, float],
        half: bool,
    ) -> None:
        """Makes tiles of what is constant and writes the file."""
