"""numpy's ``.npy``: the voxels and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from octobrick.store.export.losses import losses
from octobrick.store.export.options import WriterOptions
from octobrick.store.export.region import Region
from octobrick.store.export.stream import write_voxels


def write_npy(region: Region, path: Path, options: WriterOptions) -> list[str]:  # noqa: ARG001
    """Write a region, C order [z, y, x]; returns what ``.npy`` cannot hold."""
    header = {
        "descr": region.dtype.newbyteorder("<").str,
        "fortran_order": False,
        "shape": region.shape_zyx,
    }
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        write_voxels(file, region)
    return losses(region, "npy", "spacing", "unit", "origin", "direction", "rescale")
