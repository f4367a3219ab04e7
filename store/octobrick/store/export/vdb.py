"""OpenVDB: one float grid, of all voxels or of those in a range of values."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import UnsupportedError
from octobrick.store.box import Zyx
from octobrick.store.export.losses import losses
from octobrick.store.export.options import WriterOptions
from octobrick.store.export.region import Region

_GRID_NAME = "density"  # what renderers look for


def write_vdb_grid(region: Region, path: Path, options: WriterOptions) -> list[str]:
    """Write a region as a grid of floats; returns what OpenVDB cannot hold.

    Floats, because renderers take no other density; they hold every sample of 16 bits exactly.
    Memory grows with the active voxels.

    Raises:
        UnsupportedError: this octobrick has no writer of OpenVDB.
        ResourceError: it was built without OpenVDB.
    """
    try:
        writer = importlib.import_module("octobrick.store.vdb_writer")
    except ImportError as error:
        raise UnsupportedError(
            f"{path.name}: this octobrick cannot write OpenVDB; export to .nrrd or .ome.zarr"
        ) from error
    writer.write_vdb(
        path,
        _boxes(region),
        dtype="float32",
        name=_GRID_NAME,
        active=options.active,
        spacing_zyx=region.spacing_xyz[::-1],
        origin_xyz=region.aligned_origin_xyz,
    )
    return losses(region, "OpenVDB", "unit", "direction", "rescale")


def _boxes(region: Region) -> Iterator[tuple[Zyx, NDArray[Any]]]:
    z = 0
    for slab in region.slabs():
        yield (z, 0, 0), slab.astype(np.float32, copy=False)
        z += len(slab)
