"""OpenVDB, through the store's own writer."""

from __future__ import annotations

import importlib
from pathlib import Path

from octobrick.codec.errors import UnsupportedError
from octobrick.store.export.region import Region


def write_vdb_grid(region: Region, path: Path, compress: bool) -> list[str]:  # noqa: ARG001
    """Write a region as one grid.

    Raises:
        UnsupportedError: this octobrick was made without the writer.
    """
    try:
        importlib.import_module("octobrick.store.vdb_writer")
    except ImportError as error:
        raise UnsupportedError(
            f"{path.name}: this octobrick cannot write OpenVDB; export to .nrrd or .ome.zarr"
        ) from error
    raise NotImplementedError(region)
