"""A light field: pictures of a scene from anywhere between the cameras that took its views."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.budget import parse_nbytes
from octobrick.renderer.image import Fidelity, RenderedImage, RenderStats, checked_background
from octobrick.renderer.light_field.eye import INTERPOLATIONS, Eye, Interpolation
from octobrick.renderer.light_field.resampling import add_view, shares
from octobrick.renderer.light_field.view_cache import ViewCache, ViewSource

_BLACK = (0.0, 0.0, 0.0)


class LightField:
    """A volume of views, ready to be looked at. Not safe to use from several threads.

    It needs no OpenGL. Only bricks that hold a view in use are read.

    Args:
        volume: what ingest made of a grid of pictures; it stays the caller's to close.
        memory_budget: for decoded views, such as ``"128MiB"`` or a number of bytes.

    Attributes:
        nu: cameras along u.
        nv: cameras along v.

    Raises:
        UnsupportedError: the volume is no light field.
        InvalidInputError: a budget that is no amount of memory.
    """

    def __init__(self, volume: ViewSource, memory_budget: str | int = "128MiB") -> None:
        self._volume = volume
        self._cache = ViewCache(volume, parse_nbytes(memory_budget, "memory_budget"))
        self.nu, self.nv = self._cache.grid.nu, self._cache.grid.nv

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of pictures, those of the views."""
        ny, nx = self._cache.shape_yx
        return nx, ny

    def view(self, u: int, v: int) -> NDArray[Any]:
        """A view as it is stored, decoded: (y, x, c) in the sample type, c being 1 or 3.

        Raises:
            InvalidInputError: there is no such view.
            CorruptBrickError, VolumeFormatError, ServerUnreachableError: as reading raises them.
        """
        return self._cache.get([(u, v)])[u, v].copy()

    def render(
        self,
        eye: Eye,
        interpolation: Interpolation = "uvst",
        background: Sequence[float] | None = _BLACK,
    ) -> RenderedImage:
        """What the eye sees, of the size of a view.

        With the eye at a camera, ``spread`` 0, it is the view of that camera, exactly. Where some
        of the views that are blended do not reach, the others count; where none does, the picture
        has the background.

        Args:
            eye: where it is and on what it is focused.
            interpolation: "nearest" takes a pixel as it is, "st" blends four pixels of the nearest
                view, "uvst" four pixels of each of four views.
            background: red, green, blue, 0 to 1; None for transparent.

        Raises:
            InvalidInputError: the eye is beside the cameras, or another interpolation.
            CorruptBrickError, VolumeFormatError, ServerUnreachableError: as reading raises them.
        """
        started = time.perf_counter()
        if interpolation not in INTERPOLATIONS:
            raise InvalidInputError(
                f"interpolation {interpolation!r:.40}: choose one of {', '.join(INTERPOLATIONS)}"
            )
        behind = checked_background(background)
        eye.require_within(self.nu, self.nv)
        ny, nx = self._cache.shape_yx
        columns = shares(eye.u, eye, nx, nx, self.nu, interpolation)
        rows = shares(eye.v, eye, ny, nx, self.nv, interpolation)
        bricks_before = self._cache.bricks_read
        total = np.zeros((ny, nx, self._volume.nc), np.float32)
        weight = np.zeros((ny, nx), np.float32)
        # One row of cameras at a time: an eye far behind them sees through many.
        for v, along_y in rows.items():
            views = self._cache.get((u, v) for u in columns)
            for (u, _), pixels in views.items():
                add_view(total, weight, pixels, along_y, columns[u])
        seen = [(u, v) for v in rows for u in columns]
        return self._finished(total, weight, behind, seen, bricks_before, started)

    def _finished(
        self,
        total: NDArray[np.float32],
        weight: NDArray[np.float32],
        background: tuple[float, float, float] | None,
        seen: list[tuple[int, int]],
        bricks_before: int,
        started: float,
    ) -> RenderedImage:
        opaque = weight > 0
        premultiplied = np.zeros((*weight.shape, 4), np.float32)
        scale = np.float32(1 / np.iinfo(self._volume.dtype).max)
        np.divide(total, weight[..., np.newaxis], out=total, where=opaque[..., np.newaxis])
        premultiplied[..., :3] = total * scale
        premultiplied[..., 3] = opaque
        shown = premultiplied
        if background is not None:
            behind = np.array([*background, 1], np.float32)
            shown = np.where(opaque[..., np.newaxis], premultiplied, behind)
        rgba = np.floor(shown * 255 + 0.5).astype(np.uint8)
        seconds = time.perf_counter() - started
        fidelity = Fidelity(0, 0, self._cache.max_error(seen), converged=True)
        return RenderedImage(rgba, premultiplied, fidelity, self._stats(bricks_before, seconds))

    def _stats(self, bricks_before: int, seconds: float) -> RenderStats:
        """What the picture cost; without slabs and a GPU, of which nothing was used."""
        decoded = self._cache.bricks_read - bricks_before
        voxels = int(np.prod(self._volume.brick_shape_zyx))
        top = float(np.iinfo(self._volume.dtype).max)
        return RenderStats(
            level=0,
            bricks={"decoded": decoded},
            slabs=0,
            slabs_planned=0,
            uploaded_nbytes=0,
            resident_nbytes=self._cache.nbytes,
            decoded_nbytes=decoded * voxels * self._volume.dtype.itemsize,
            slab_nbytes=0,
            step_world=0.0,
            reference_length_world=0.0,
            window=(0.0, top),
            milliseconds={"total": seconds * 1000},
            gl_renderer="none",
        )
