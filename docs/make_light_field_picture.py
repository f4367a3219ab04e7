"""Makes the picture of light-fields.md: what interpolation and focus do between cameras.

python docs/make_light_field_picture.py LF.zarr      writes docs/images/light-field.jpg

LF.zarr is what the first command of that page makes of the light field that it names.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from octobrick.renderer.light_field import Eye, LightField
from octobrick.store import open_volume

OUT = Path(__file__).parent / "images" / "light-field.jpg"
QUALITY = 85
PART = (slice(30, 220), slice(40, 300))  # rows and columns
PANELS = (
    (Eye(7.5, 7.5, 1.2), "nearest"),
    (Eye(7.5, 7.5, 1.2), "st"),
    (Eye(7.5, 7.5, 1.2), "uvst"),
    (Eye(7.5, 7.5, 0.0), "uvst"),
    (Eye(7.5, 7.5, 2.4), "uvst"),
    (Eye(7.5, 7.5, 1.2, spread=12), "uvst"),
)
"""Upper row: interpolations. Lower row: focus behind and before, and an eye behind the cameras."""


def main(volume: Path) -> None:
    """Write the picture."""
    with open_volume(volume) as opened:
        scene = LightField(opened)
        parts = [scene.render(eye, how).rgba[PART][..., :3] for eye, how in PANELS]  # type: ignore[arg-type]
    rows = [np.hstack(parts[start : start + 3]) for start in (0, 3)]
    Image.fromarray(np.vstack(rows)).save(OUT, quality=QUALITY, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
