"""The directions of gradients, level by level, as a stream beside that of the voxels.

Gradients are taken from the voxels of level 0 and reduced from level to level, weighted by their
magnitude, before each is coded: so a coarse level's directions are not those of blurred voxels
(Díaz-García et al. 2017). As a reduction looks at 2×2×2 gradients, a brick of level 0 gives its
part of several levels by itself; only beyond do parts of many bricks meet.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import gradients
from octobrick.store.box import Zyx, ceil_div
from octobrick.store.brick_work import BrickResult
from octobrick.store.window import Window

Vectors = NDArray[np.float32]
Emit = Callable[[int, int, Window], None]


def gradient_array(level: int) -> str:
    """The path of the array of a level's gradients, below the volume."""
    return f"gradient/{level}"


class GradientPyramid:
    """The gradients of one channel of one time step at half resolution and coarser.

    Args:
        shapes_zyx: of the voxels' levels; gradients have levels 1 up to the last.
        nlocal: the last of these levels that bricks of level 0 give by themselves.
        brick: voxels per brick and axis.
        windows: by arrays; each takes the planes of a layer.
        emit: called with level, layer and window when the planes of a layer are complete.
    """

    def __init__(
        self,
        shapes_zyx: tuple[Zyx, ...],
        nlocal: int,
        brick: int,
        windows: Mapping[str, Window],
        emit: Emit,
    ) -> None:
        self._shapes_zyx, self._brick, self._nlocal = shapes_zyx, brick, nlocal
        self._emit = emit
        self.levels = range(1, len(shapes_zyx))
        self.windows = {level: windows[gradient_array(level)] for level in self.levels}
        self.layers = dict.fromkeys(self.levels, 0)
        # Beyond the levels that bricks give: planes of gradients as they come, and of each level
        # the one that waits for its second.
        self._planes: Vectors | None = None
        self.waiting: dict[int, Vectors] = {}

    def put(self, layer: int, y: int, row: Sequence[BrickResult]) -> None:
        """Take what a row of bricks of level 0 gave."""
        for level in range(1, self._nlocal + 1):
            size = self._brick >> level
            blocks = [result.directions[level - 1] for result in row]
            self.windows[level].put_blocks(layer * size, y * size, blocks)
        if len(self.levels) > self._nlocal:
            self._keep(y, np.concatenate([r.gradient for r in row if r.gradient is not None], 2))

    def complete_to(self, z: int) -> None:
        """All bricks of level 0 before plane ``z`` have been put."""
        is_last = z == self._shapes_zyx[0][0]
        for level in range(1, self._nlocal + 1):
            self._complete(level, ceil_div(z, 2**level))
        if self._planes is not None:
            planes, self._planes = self._planes, None
            self._reduce(self._nlocal, planes, is_last=is_last)

    def _keep(self, y: int, rows: Vectors) -> None:
        """Note rows of the last level that bricks give, until their planes are complete."""
        if self._planes is None:
            _, ny, nx = self._shapes_zyx[self._nlocal]
            self._planes = np.empty((len(rows), ny, nx, 3), np.float32)
        start = y * (self._brick >> self._nlocal)
        self._planes[:, start : start + rows.shape[1]] = rows

    def _reduce(self, level: int, planes: Vectors, *, is_last: bool) -> None:
        """Make the next level of planes of this one, by pairs; one may have to wait."""
        if level + 1 == len(self._shapes_zyx):
            return
        waiting = self.waiting.pop(level, None)
        if waiting is not None:
            planes = np.concatenate([waiting, planes])
        npaired = len(planes) if is_last else len(planes) & ~1
        if npaired < len(planes):
            self.waiting[level] = planes[npaired:].copy()
        if not npaired:
            return
        coarse = gradients.reduce(planes[:npaired])
        window = self.windows[level + 1]
        for plane in coarse:
            window.put(window.stop_z, 0, gradients.encode_directions(plane[np.newaxis]))
            self._complete(level + 1, window.stop_z + 1)
        self._reduce(level + 1, coarse, is_last=is_last)

    def _complete(self, level: int, z: int) -> None:
        window, nz = self.windows[level], self._shapes_zyx[level][0]
        window.complete_to(z)
        stop_z = min((self.layers[level] + 1) * self._brick, nz)
        if z == stop_z:
            self._emit(level, self.layers[level], window)
            self.layers[level] += 1
            window.drop_to(stop_z)
