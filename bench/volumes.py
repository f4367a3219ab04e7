"""Real volumes for measurements: what a folder holds, in crops."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.arrays import SAMPLE_DTYPES
from octobrick.codec.errors import OctobrickError
from octobrick.store.box import Box
from octobrick.store.sources import Source, open_source

READABLE = (".gz", ".mhd", ".nii", ".npy", ".nrrd", ".tif")


def volumes(folder: Path, crop: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Name and central crop of every scalar volume that can be read.

    Of a folder inside, which holds time steps, the first.
    """
    entries = sorted(folder.iterdir())
    series = [min(f.glob("*.gz"), default=None) for f in entries if f.is_dir()]
    for path in [f for f in entries if f.is_file()] + [f for f in series if f]:
        if path.suffix not in READABLE:
            continue
        try:
            with open_source(path) as source:
                voxels = _crop(source, crop) if source.nc == 1 else None
        except OctobrickError as error:
            print(f"# skipped {path.name}: {error.kind}")
            continue
        if voxels is not None and voxels.dtype in SAMPLE_DTYPES and np.ptp(voxels) > 0:
            yield path.name, voxels


def central(shape: tuple[int, ...], crop: int) -> tuple[slice, ...]:
    """The middle of a volume, at most `crop` voxels on each axis."""
    begin = [max(0, (n - crop) // 2) for n in shape]
    return tuple(slice(b, min(n, b + crop)) for n, b in zip(shape, begin, strict=True))


def source_crop(path: Path, crop: int) -> NDArray[Any]:
    """The crop of anything that octobrick reads; of colours the first."""
    with open_source(path) as source:
        return _crop(source, crop)


def _crop(source: Source, crop: int) -> NDArray[Any]:
    z, y, x = central(source.shape_zyx, crop)
    return source.read(Box((z.start, y.start, x.start), (z.stop, y.stop, x.stop)))
