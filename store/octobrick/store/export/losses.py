"""What a format cannot hold of a region, told instead of dropped in silence."""

from __future__ import annotations

import numpy as np

from octobrick.store.export.region import Region


def losses(region: Region, name: str, *unheld: str) -> list[str]:
    """A sentence that names what is lost, of the ``unheld`` that this region has; or nothing.

    Args:
        region: what is exported.
        name: of the format.
        unheld: of spacing, unit, origin, direction and rescale.
    """
    values = {
        "spacing": None if region.spacing_xyz == (1, 1, 1) else f"{region.spacing_xyz} (x, y, z)",
        "unit": region.unit,
        "origin": None if region.origin_xyz == (0, 0, 0) else f"{region.origin_xyz} (x, y, z)",
        "direction": _direction(region),
        "rescale": region.rescale and f"{region.rescale} (slope, intercept)",
    }
    lost = [f"{what} {values[what]}" for what in unheld if values[what] is not None]
    return [f"{name} does not hold {', '.join(lost)}; note it down"] if lost else []


def _direction(region: Region) -> str | None:
    if region.direction is None or np.allclose(region.direction, np.eye(3)):
        return None
    return str(np.round(region.direction, 6).tolist())
