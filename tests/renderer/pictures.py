"""Pictures that no renderer made: known pixels for what is done with pictures afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer import Fidelity, RenderedImage, RenderStats
from octobrick.renderer.image import Background


def ramp(size: tuple[int, int] = (40, 24), background: Any = (0.1, 0.2, 0.3)) -> RenderedImage:
    """Colours that change smoothly, opaque at the right and transparent at the left."""
    width, height = size
    across = np.linspace(0, 1, width, dtype=np.float32)[None, :, None]
    down = np.linspace(0, 1, height, dtype=np.float32)[:, None, None]
    color = np.concatenate(np.broadcast_arrays(across, down, 1 - across), axis=-1)
    alpha = np.broadcast_to(across, (height, width, 1))
    gathered = np.concatenate([color * alpha, alpha], axis=-1)
    stats = RenderStats(0, {}, 1, 1, 0, 0, 0, 0, 1.0, 1.0, (-100.0, 900.0), {"total": 1.0}, "x")
    return RenderedImage(finish(gathered, background), gathered, Fidelity(0, 0, 2.0, True), stats)


def finish(premultiplied: NDArray[np.float32], background: Background) -> NDArray[np.uint8]:
    """8-bit RGBA with straight alpha of what rays gathered, over a background if there is one."""
    color, alpha = premultiplied[..., :3], premultiplied[..., 3:]
    if background is not None:
        color = color + (1 - alpha) * np.array(background, np.float32)
        alpha = np.ones_like(alpha)
    else:
        color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
    rgba = np.concatenate([color, alpha], axis=-1)
    return np.asarray(np.rint(np.clip(rgba, 0, 1) * 255), np.uint8)
