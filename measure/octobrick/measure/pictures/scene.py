"""What all pictures of a sweep have in common: cameras, colours, window, size, step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.measure.pictures.paths import SLAB, RenderPath
from octobrick.measure.pictures.views import ViewChoice
from octobrick.renderer import Camera, RenderedImage, Renderer, TransferFunction, visible_bounds
from octobrick.store import Volume

PRESETS: Final = ("ct-bone", "ct-soft-tissue", "mr", "microscopy")
"""In the order in which they are tried: the first is what `octobrick render` takes by itself."""
_SHARE_MIN: Final = 0.03
"""Of pixels that must show something: below it, a comparison would be one of backgrounds."""
_OPACITY_MIN: Final = 0.1
_TRIAL_SIZE: Final = (96, 96)
_CLI_STEP_VOXELS: Final = 0.5


@dataclass(frozen=True, slots=True)
class Scene:
    """One part of a volume as it is looked at.

    Attributes:
        preset: name of the transfer function.
        window: values at its ends; None of a part that has one value only, for the renderer's own.
        cameras: one for each view.
        size: (width, height) in pixels.
        step_voxels: distance of samples, in voxels of the level that is drawn.
    """

    preset: str
    window: tuple[float, float] | None
    cameras: tuple[Camera, ...]
    size: tuple[int, int]
    step_voxels: float

    @classmethod
    def of(
        cls,
        renderer: Renderer,
        volume: Volume,
        views: Sequence[ViewChoice],
        *,
        preset: str | None,
        window: tuple[float, float] | None,
        size: tuple[int, int],
        step_voxels: float,
    ) -> Scene:
        """The scene around what is visible of a volume.

        Without a preset the first of `PRESETS` that shows something, or that which shows most.

        Raises:
            InvalidInputError: no views.
            NotFoundError: no such preset.
        """
        if not views:
            raise InvalidInputError("no views; give at least one")
        low, high = volume.window if window is None else window
        shown = (float(low), float(high)) if low < high else None

        def scene(name: str) -> Scene:
            bounds = visible_bounds(volume, TransferFunction.preset(name), shown)
            cameras = tuple(
                Camera.orbit(volume, view.azimuth, view.elevation, bounds=bounds).zoomed(view.zoom)
                for view in views
            )
            return cls(name, shown, cameras, size, step_voxels)

        if preset is not None:
            return scene(preset)
        best, best_share = scene(PRESETS[0]), -1.0
        for name in PRESETS:
            candidate = scene(name)
            share = candidate._share_shown(renderer, volume)
            if share > best_share:
                best, best_share = candidate, share
            if share >= _SHARE_MIN:
                break
        return best

    @property
    def flags(self) -> tuple[str, ...]:
        """Of `octobrick render`, for what all pictures have in common but cameras."""
        step = () if self.step_voxels == _CLI_STEP_VOXELS else ("--step", f"{self.step_voxels:g}")
        width, height = self.size
        return ("--preset", self.preset, "--size", f"{width}x{height}", *step)

    def draw(
        self, renderer: Renderer, volume: Volume, path: RenderPath, view: int, **other: Any
    ) -> RenderedImage:
        """The picture of one view."""
        arguments: dict[str, Any] = {"size": self.size, **path.arguments, **other}
        return renderer.render(
            volume,
            self.cameras[view],
            TransferFunction.preset(self.preset),
            window=self.window,
            step_voxels=self.step_voxels,
            **arguments,
        )

    def _share_shown(self, renderer: Renderer, volume: Volume) -> float:
        image = self.draw(renderer, volume, SLAB, 0, size=_TRIAL_SIZE)
        return float(np.mean(image.premultiplied[..., 3] > _OPACITY_MIN))
