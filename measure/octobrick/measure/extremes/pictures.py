"""How far pictures keep to the optics they are made by, however they are made."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.measure.extremes.memory_source import MemorySource
from octobrick.measure.extremes.search import Promise
from octobrick.renderer import Camera, Renderer, Slice, TransferFunction

_WHITE = ((0.0, (1.0, 1.0, 1.0)),)
_GREY = TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 1.0),))
_SHAPE = (12, 20, 28)
_MIDDLE = (13.5, 9.5, 5.5)
_OPACITY = "an even medium has the opacity of the way through it; the error, of that opacity"

PICTURE_PROMISES = (
    ("step, voxels", _OPACITY),
    ("opacity per voxel, steps of 0.5", _OPACITY),
    ("angle of view, degrees", _OPACITY),
    ("180° less the angle of view, degrees", _OPACITY),
    ("distance of the eye, voxels", _OPACITY),
    ("spacing z ÷ x", _OPACITY),
    ("zoom on a voxel", "its value is in the middle of the picture; the error, of the range"),
    (
        "float32 range of the volume",
        "a slice shows the voxels' values; the error, of the range",
    ),
    ("memory of a slab, KiB", "any slab gives the same picture; the difference of colours, 0 to 1"),
)
"""Parameter and promise of each search, for where there is no OpenGL."""


class Scenes:
    """A renderer, and what is drawn with it. Close it, or use it in a with statement.

    Raises:
        ResourceError: there is no OpenGL, or no moderngl.
    """

    def __init__(self) -> None:
        self._renderer = Renderer("64MiB")
        self.device = self._renderer.gl_renderer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    def opacity(
        self,
        camera: Camera,
        per_voxel: float,
        step_voxels: float = 0.5,
        spacing_z: float = 1.0,
    ) -> float:
        """Of the middle of a picture of an even medium."""
        source = MemorySource(np.full(_SHAPE, 7, np.uint8), None, (1.0, 1.0, spacing_z))
        function = TransferFunction(_WHITE, ((0.0, per_voxel),))
        image = self._renderer.render(
            source, camera, function, (17, 17), shading=False, step_voxels=step_voxels
        )
        if not np.isfinite(image.premultiplied).all():
            return math.nan
        return float(image.premultiplied[8, 8, 3])

    def slice_values(
        self, array: NDArray[Any], z: float, zoom: float, size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """The grey of a plane across z around its voxel (y, x) = (4, 8), 0 to 1."""
        camera = Camera((8.0, 4.0, z - 50.0), (8.0, 4.0, z), (0.0, -1.0, 0.0), None, 20.0)
        image = self._renderer.render(
            MemorySource(array), camera.zoomed(zoom), _GREY, size,
            mode=Slice((0.0, 0.0, z), (0.0, 0.0, 1.0)),
        )  # fmt: skip
        return image.premultiplied[..., 0].astype(np.float64)

    def of_slabs(self, nbytes: int, array: NDArray[np.uint8]) -> NDArray[np.float32]:
        """A picture with another memory for slabs."""
        source = MemorySource(array, S3dc(bits=4))
        function = TransferFunction(_WHITE, ((0.1, 0.0), (0.6, 0.2)))
        camera = Camera.orbit(source, 30, 20)
        with Renderer("64MiB", slab_budget=nbytes) as renderer:
            return renderer.render(source, camera, function, (24, 24)).premultiplied


def picture_promises(scenes: Scenes) -> Iterator[Promise]:
    """What is searched of the renderer, in the order of `PICTURE_PROMISES`."""
    limits: list[tuple[float, Any, float, float, float]] = [
        (2e-3, partial(_of_step, scenes), 0.5, 1 / 64, 4.0),
        (2e-3, partial(_of_opacity, scenes), 0.1, 1e-12, 0.9999),
        (0.02, partial(_of_angle, scenes), 30.0, 1e-12, 90.0),
        (0.02, partial(_of_wide_angle, scenes), 90.0, 1e-7, 90.0),
        (0.02, partial(_of_distance, scenes), 100.0, 20.0, 1e12),
        (0.02, partial(_of_spacing, scenes), 1.0, 1e-4, 1e4),
        (2e-3, partial(_of_zoom, scenes), 28.0, 1.0, 1e12),
        (2e-3, partial(_of_range, scenes), 1.0, 2.0**-140, float(np.finfo(np.float32).max)),
        (1e-5, _OfSlabs(scenes), 256.0, 24.0, 8192.0),
    ]
    for (parameter, promise), limit in zip(PICTURE_PROMISES, limits, strict=True):
        tolerance, check, start, low, high = limit
        yield Promise(
            "renderer", scenes.device, parameter, promise, tolerance, check, start, low, high,
            "log", 5,
        )  # fmt: skip


def _along_y(fov_degrees: float | None = None, distance: float = 100.0) -> Camera:
    eye = (_MIDDLE[0], _MIDDLE[1] - distance, _MIDDLE[2])
    return Camera(eye, _MIDDLE, fov_degrees=fov_degrees, height_world=None if fov_degrees else 2.0)


def _off(found: float, per_voxel: float, length: float) -> float:
    wanted = -math.expm1(length * math.log1p(-per_voxel))
    return abs(found / wanted - 1)


def _of_step(scenes: Scenes, step: float) -> float:
    return _off(scenes.opacity(_along_y(), 0.05, step), 0.05, 20)


def _of_opacity(scenes: Scenes, per_voxel: float) -> float:
    return _off(scenes.opacity(_along_y(), per_voxel), per_voxel, 20)


def _of_angle(scenes: Scenes, degrees: float) -> float:
    return _off(scenes.opacity(_along_y(degrees), 0.05), 0.05, 20)


def _of_wide_angle(scenes: Scenes, short_of_180: float) -> float:
    """From afar, so that a ray that is off misses, and from several places: rounding has luck."""
    cameras = [_along_y(180 - short_of_180, away) for away in (300.0, 309.5, 317.3)]
    return max(_off(scenes.opacity(camera, 0.05), 0.05, 20) for camera in cameras)


def _of_distance(scenes: Scenes, distance: float) -> float:
    return _off(scenes.opacity(_along_y(None, distance), 0.05), 0.05, 20)


def _of_spacing(scenes: Scenes, ratio: float) -> float:
    """Along z, where the smallest spacing is the unit of opacity and of steps."""
    length = 12 * ratio / min(1.0, ratio)
    per_unit = -math.expm1(-1 / length)
    middle = (_MIDDLE[0], _MIDDLE[1], _MIDDLE[2] * ratio)
    eye = (middle[0], middle[1], middle[2] - 100 * max(1.0, ratio))
    camera = Camera(eye, middle, (0.0, 1.0, 0.0), None, 2.0)
    return _off(scenes.opacity(camera, per_unit, 4.0, ratio), per_unit, length)


def _waves(size: float = 1.0) -> NDArray[np.float32]:
    z, y, x = np.indices((8, 20, 20))
    waves: NDArray[np.float64] = np.sin(x / 5) * np.cos(y / 6 + z / 3)
    return (waves * size).astype(np.float32)


def _of_zoom(scenes: Scenes, zoom: float) -> float:
    array = _waves()
    low, high = float(array.min()), float(array.max())
    found = float(scenes.slice_values(array, 6.0, zoom, (9, 9))[4, 4])
    return abs(found - (float(array[6, 4, 8]) - low) / (high - low))


def _of_range(scenes: Scenes, size: float) -> float:
    array = _waves(size)
    low, high = float(array.min()), float(array.max())
    if high <= low:
        return math.inf
    found = scenes.slice_values(array, 6.0, 20.0 / 9, (9, 9))  # a voxel a pixel
    wanted = (array[6, 0:9, 4:13].astype(np.float64) - low) / (high - low)
    return float(np.abs(found - wanted).max())


class _OfSlabs:
    """The greatest difference to a picture of one slab."""

    def __init__(self, scenes: Scenes) -> None:
        z, y, x = np.indices((40, 36, 44))
        unit = np.clip(np.sin(x / 5) * np.cos(y / 6) + 0.3 * np.sin(z / 3), 0, 1)
        self._scenes, self._array = scenes, (unit * 240).astype(np.uint8)
        self._whole: NDArray[np.float32] | None = None

    def __call__(self, kibibytes: float) -> float:
        if self._whole is None:
            self._whole = self._scenes.of_slabs(16 << 20, self._array)
        found = self._scenes.of_slabs(int(kibibytes * 1024), self._array)
        return float(np.abs(found - self._whole).max())
