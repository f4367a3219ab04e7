"""Pictures that no renderer made: known pixels for what is done with pictures afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np

from octobrick.renderer import Fidelity, RenderedImage, RenderStats
from octobrick.renderer.image import finish


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
