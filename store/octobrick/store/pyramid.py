"""The pyramid as a stream: planes of level 0 go in from below, brick layers of all levels come out.

Each level holds one layer of bricks and a plane on either side, so memory is bounded by a slab of
the volume (4/3 of it over all levels), never by the volume.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import reduce
from octobrick.store.box import Zyx

Voxels = NDArray[np.generic]
Reducer = Callable[[Voxels], Voxels]

REDUCERS: dict[str, Reducer] = {
    "mean": reduce.mean2,
    "max": reduce.max2,
    "min": reduce.min2,
    "mode": reduce.mode2,
    "nearest": reduce.nearest2,
}


@dataclass(frozen=True, slots=True)
class Layer:
    """All voxels of one layer of bricks, with a plane of halo where the volume goes on.

    ``planes[i]`` is the plane ``first_z + i`` of the level. The array is reused for the next
    layer: what is to outlive the call that got it must be copied.
    """

    level: int
    index: int
    first_z: int
    planes: Voxels


class Held(NamedTuple):
    """The state of one level: its next layer, and the planes held from ``first_z`` on."""

    layer: int
    first_z: int
    planes: Voxels


class LevelStream:
    """Gathers the planes of one level into layers, hands them out and feeds the next level.

    Args:
        level: which level this is; 0 is the original.
        shapes_zyx: the shapes of all levels.
        dtype: sample type.
        brick: voxels per brick and axis; even, so that layers reduce without looking further.
        reducer: makes the voxels of the next level.
        emit: called with each layer, in order, the finer levels' layers first.
    """

    def __init__(
        self,
        level: int,
        shapes_zyx: tuple[Zyx, ...],
        dtype: np.dtype[np.generic],
        brick: int,
        reducer: Reducer,
        emit: Callable[[Layer], None],
    ) -> None:
        self._level = level
        self._nz, ny, nx = shapes_zyx[level]
        self._brick = brick
        self._reducer = reducer
        self._emit = emit
        self._coarser = (
            LevelStream(level + 1, shapes_zyx, dtype, brick, reducer, emit)
            if level + 1 < len(shapes_zyx)
            else None
        )
        self._window = np.empty((min(brick + 2, self._nz), ny, nx), dtype)
        self._first_z = 0  # the level's z of window[0]
        self._nheld = 0  # planes in the window
        self._layer = 0

    def push(self, planes: Voxels) -> None:
        """Take the next planes; emits every layer that they complete."""
        while len(planes):
            ntaken = min(len(planes), len(self._window) - self._nheld)
            self._window[self._nheld : self._nheld + ntaken] = planes[:ntaken]
            self._nheld += ntaken
            planes = planes[ntaken:]
            self._emit_if_complete()

    @property
    def nlayers_emitted(self) -> int:
        """How many layers of this level are done."""
        return self._layer

    def held(self) -> list[Held]:
        """What this level and the coarser ones have not handed out yet, or still need."""
        mine = Held(self._layer, self._first_z, self._window[: self._nheld])
        return [mine, *(self._coarser.held() if self._coarser else ())]

    def restore(self, held: list[Held]) -> None:
        """Go on where another stream was when `held` gave this."""
        self._layer, self._first_z, self._nheld = (
            held[0].layer,
            held[0].first_z,
            len(held[0].planes),
        )
        self._window[: self._nheld] = held[0].planes
        if self._coarser is not None:
            self._coarser.restore(held[1:])

    def _emit_if_complete(self) -> None:
        while self._layer * self._brick < self._nz:
            start_z = self._layer * self._brick
            stop_z = min(start_z + self._brick, self._nz)
            halo_stop_z = min(stop_z + 1, self._nz)
            if self._first_z + self._nheld < halo_stop_z:
                return
            self._emit(Layer(self._level, self._layer, self._first_z, self._window[: self._nheld]))
            if self._coarser is not None:
                core = self._window[start_z - self._first_z : stop_z - self._first_z]
                self._coarser.push(self._reducer(core))
            self._layer += 1
            self._keep_from(stop_z - 1)

    def _keep_from(self, z: int) -> None:
        ndropped = z - self._first_z
        nkept = self._nheld - ndropped
        self._window[:nkept] = self._window[ndropped : self._nheld].copy()
        self._first_z, self._nheld = z, nkept


def level_shapes(shape_zyx: Zyx, brick: int, nlevels: int | None = None) -> tuple[Zyx, ...]:
    """The shapes of a pyramid: each level half as fine per axis, rounded up.

    Without ``nlevels`` the last level is the first that fits into one brick.
    """
    shapes = [shape_zyx]
    while (max(shapes[-1]) > brick) if nlevels is None else (len(shapes) < nlevels):
        z, y, x = shapes[-1]
        shapes.append(((z + 1) // 2, (y + 1) // 2, (x + 1) // 2))
    return tuple(shapes)
