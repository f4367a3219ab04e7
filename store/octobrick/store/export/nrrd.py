"""NRRD, header and data in one file, raw or gzip.

Source: https://teem.sourceforge.net/nrrd/format.html.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from octobrick.store.export.losses import losses
from octobrick.store.export.options import WriterOptions
from octobrick.store.export.region import Region
from octobrick.store.export.stream import gzip_writer, write_voxels

_TYPES = {"float32": "float", "float64": "double"}  # other types have numpy's names
_UNITS = {
    "millimeter": "mm",
    "micrometer": "um",
    "nanometer": "nm",
    "centimeter": "cm",
    "meter": "m",
}


def write_nrrd(region: Region, path: Path, options: WriterOptions) -> list[str]:
    """Write a region; its space is LPS where a direction is known, else one without a name."""
    with path.open("wb") as file:
        file.write(_header(region, compress=options.compress))
        if options.compress:
            with gzip_writer(file) as compressed:
                write_voxels(compressed, region)  # type: ignore[arg-type]
        else:
            write_voxels(file, region)
    return losses(region, "NRRD", "rescale")


def _header(region: Region, *, compress: bool) -> bytes:
    axes = np.eye(3) if region.direction is None else region.direction
    columns = (axes * np.array(region.spacing_xyz)).T
    space = "space dimension: 3" if region.direction is None else "space: left-posterior-superior"
    name = region.dtype.name
    lines = [
        "NRRD0005",
        f"type: {_TYPES.get(name, name)}",
        "dimension: 3",
        space,
        f"sizes: {' '.join(str(n) for n in reversed(region.shape_zyx))}",
        f"space directions: {' '.join(_vector(column) for column in columns)}",
        "kinds: domain domain domain",
        "endian: little",
        f"encoding: {'gzip' if compress else 'raw'}",
        f"space origin: {_vector(region.origin_xyz)}",
    ]
    if region.unit:
        unit = _UNITS.get(region.unit, region.unit)
        lines.append("space units: " + " ".join([f'"{unit}"'] * 3))
    return ("\n".join(lines) + "\n\n").encode()


def _vector(numbers: Iterable[float]) -> str:
    return f"({','.join(repr(float(n) + 0.0) for n in numbers)})"  # no -0.0
