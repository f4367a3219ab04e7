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
from octobrick.store.sources import open_source

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
            voxels = tiff_crop(path, crop) if path.suffix == ".tif" else source_crop(path, crop)
        except OctobrickError as error:
            print(f"# skipped {path.name}: {error.kind}")
            continue
        if voxels.ndim == 3 and voxels.dtype in SAMPLE_DTYPES and np.ptp(voxels) > 0:
            yield path.name, voxels


def central(shape: tuple[int, ...], crop: int) -> tuple[slice, ...]:
    """The middle of a volume, at most `crop` voxels on each axis."""
    begin = [max(0, (n - crop) // 2) for n in shape]
    return tuple(slice(b, min(n, b + crop)) for n, b in zip(shape, begin, strict=True))


def source_crop(path: Path, crop: int) -> NDArray[Any]:
    """The crop of anything that octobrick reads."""
    with open_source(path) as source:
        z, y, x = central(source.shape_zyx, crop)
        return source.read(Box((z.start, y.start, x.start), (z.stop, y.stop, x.stop)))


def tiff_crop(path: Path, crop: int) -> NDArray[Any]:
    """The crop of a stack of pages, which octobrick does not read yet."""
    from PIL import Image, ImageSequence

    with Image.open(path) as image:
        pages = np.stack([np.asarray(page) for page in ImageSequence.Iterator(image)])
    native = pages.astype(pages.dtype.newbyteorder("="))
    return np.ascontiguousarray(native[central(native.shape, crop)]) if native.ndim == 3 else native
