"""Decoded views of a light field, as many as fit into a budget."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import UnsupportedError
from octobrick.renderer.brick_source import SourceLevel
from octobrick.store.box import Box, Zyx
from octobrick.store.camera_grid import CameraGrid

View = tuple[int, int]
"""Column u and row v of a camera."""

_CHANNELS = (1, 3)
_DTYPES = ("uint8", "uint16")


class ViewSource(Protocol):
    """A volume of views, as `octobrick.store.Volume` is one: on disk or on a server."""

    @property
    def light_field(self) -> CameraGrid | None:
        """The cameras whose views the slices are."""

    @property
    def levels(self) -> Any:
        """Of which only the first counts."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """uint8 or uint16."""

    @property
    def nc(self) -> int:
        """1 of gray views, 3 of RGB."""

    @property
    def brick_shape_zyx(self) -> Zyx:
        """Voxels of a brick."""

    def read(self, level: int, box: Box | None = None, t: int = 0, c: int = 0) -> NDArray[Any]:
        """Decoded voxels of a box."""

    def fidelity(self, level: int, t: int = 0, c: int = 0) -> NDArray[Any]:
        """Largest error and RMSE of each brick."""


class ViewCache:
    """Reads views and keeps those that were used last. Not safe to use from several threads.

    A brick holds pixels of many views, which are decoded together. So when views are missing,
    those beside them in the same bricks are kept too, as far as there is room.

    Args:
        source: a volume that is a light field.
        nbytes_max: of the decoded views that are kept; those of the last call are, whatever their
            size. While reading, one channel of a layer of bricks comes to it.

    Attributes:
        grid: the cameras.
        shape_yx: pixels of each view.
        bricks_read: so far, an absent brick counted like others.

    Raises:
        UnsupportedError: the volume is no light field, or its samples are no colours.
    """

    def __init__(self, source: ViewSource, nbytes_max: int) -> None:
        self.grid = _require_light_field(source)
        level: SourceLevel = source.levels[0]
        self._source = source
        self._shape_zyx = level.shape_zyx
        self.shape_yx = level.shape_zyx[1:]
        self.bricks_read = 0
        self._view_nbytes = self.shape_yx[0] * self.shape_yx[1] * source.nc * source.dtype.itemsize
        self._nviews_max = nbytes_max // self._view_nbytes
        self._views: OrderedDict[View, NDArray[Any]] = OrderedDict()
        self._layer_errors: dict[int, float] = {}

    @property
    def nbytes(self) -> int:
        """Of the decoded views that are kept."""
        return len(self._views) * self._view_nbytes

    def get(self, wanted: Iterable[View]) -> dict[View, NDArray[Any]]:
        """Views (y, x, c), read where they are not kept.

        Raises:
            CorruptBrickError, VolumeFormatError, ServerUnreachableError: as reading raises them.
        """
        wanted = list(dict.fromkeys(wanted))
        missing: dict[int, list[View]] = {}
        for view in wanted:
            if view not in self._views:
                missing.setdefault(self._layer_of(view), []).append(view)
        room = max(self._nviews_max - len(wanted), 0) // max(len(missing), 1)
        for layer, views in missing.items():
            self._read(views + self._beside(layer, views, room))
        for view in wanted:
            self._views.move_to_end(view)
        found = {view: self._views[view] for view in wanted}
        while len(self._views) > max(self._nviews_max, len(wanted)):
            self._views.popitem(last=False)
        return found

    def max_error(self, views: Iterable[View]) -> float:
        """The largest error of a sample in the bricks that hold these views."""
        layers = {self._layer_of(view) for view in views}
        if not self._layer_errors:
            tables = [self._source.fidelity(0, 0, c)[..., 0] for c in range(self._source.nc)]
            worst = np.max(tables, axis=(0, 2, 3))
            self._layer_errors = dict(enumerate(worst.tolist()))
        return max((self._layer_errors[layer] for layer in layers), default=0.0)

    def _layer_of(self, view: View) -> int:
        return self.grid.slice_of(*view) // self._source.brick_shape_zyx[0]

    def _beside(self, layer: int, views: list[View], room: int) -> list[View]:
        """Other views of a layer of bricks, the nearest to those that are read."""
        brick_nz = self._source.brick_shape_zyx[0]
        stop_z = min((layer + 1) * brick_nz, self._shape_zyx[0])
        others = dict.fromkeys(self.grid.view_of(z) for z in range(layer * brick_nz, stop_z))
        u, v = np.mean(views, axis=0).tolist()
        # One that stands in for a missing view may repeat one of another layer.
        free = [o for o in others if o not in self._views and o not in views]
        free = [o for o in free if self._layer_of(o) == layer]
        free.sort(key=lambda other: (other[0] - u) ** 2 + (other[1] - v) ** 2)
        return free[:room]

    def _read(self, views: list[View]) -> None:
        """Decode the bricks of a layer once, and keep these of its views."""
        source, (ny, nx) = self._source, self.shape_yx
        slices = [self.grid.slice_of(*view) for view in views]
        box = Box((min(slices), 0, 0), (max(slices) + 1, ny, nx))
        made = [np.empty((ny, nx, source.nc), source.dtype) for _ in views]
        _, brick_ny, brick_nx = source.brick_shape_zyx
        for c in range(source.nc):
            voxels = source.read(0, box, 0, c)
            for picture, z in zip(made, slices, strict=True):
                picture[..., c] = voxels[z - box.start_zyx[0]]
            self.bricks_read += -(-ny // brick_ny) * -(-nx // brick_nx)
        self._views.update(zip(views, made, strict=True))


def _require_light_field(source: ViewSource) -> CameraGrid:
    grid = source.light_field
    if grid is None:
        raise UnsupportedError(
            "the volume is no light field; ingest a grid of pictures with --light-field"
        )
    if source.nc not in _CHANNELS or source.dtype.name not in _DTYPES:
        raise UnsupportedError(
            f"a light field of {source.nc} channels of {source.dtype}: views are gray or RGB, of "
            "uint8 or uint16; convert the pictures and ingest them again"
        )
    return grid
