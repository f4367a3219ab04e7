"""Real volumes with a view of each, and how alike two pictures are."""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import _measure
import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.renderer import Camera, TransferFunction, visible_bounds
from octobrick.store import Volume, ingest, open_volume


@dataclass(frozen=True)
class Scene:
    """A real volume and how it is shown."""

    file: str
    preset: str
    zoom: float = 1.0


SCENES = (
    Scene("ct_bonsai.nii.gz", "ct-soft-tissue"),
    Scene("ct_vhf_head.mhd", "ct-bone"),
    Scene("ct_cranium.nrrd", "ct-bone"),
    Scene("mri_vs_t1c.nii.gz", "mr"),
    Scene("sim_heptane.nii.gz", "microscopy"),
)


def stored(scene: Scene, data: Path, name: str, **ingesting: Any) -> Volume:
    """The scene's volume, of a folder, ingested in some way."""
    folder = _measure.OUT / "scenes" / Path(sys.argv[0]).stem  # its own: two may run at once
    path = folder / f"{scene.file.split('.')[0]}-{name}.zarr"
    shutil.rmtree(path, ignore_errors=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    ingest(data / scene.file, path, **ingesting)
    return open_volume(path)


def camera_of(volume: Volume, scene: Scene) -> tuple[Camera, TransferFunction]:
    """All of what its transfer function shows, from the front, a little from the side and above."""
    function = TransferFunction.preset(scene.preset)
    bounds = visible_bounds(volume, function)
    return Camera.orbit(volume, 30, 20, bounds=bounds).zoomed(scene.zoom), function


def likeness(wanted: NDArray[np.uint8], found: NDArray[np.uint8]) -> dict[str, float]:
    """PSNR (peak 255, all channels) and SSIM (of the mean of channels) of two pictures."""
    return {
        "psnr": metrics.psnr(wanted, found, peak=255),
        "ssim": metrics.ssim(wanted.mean(axis=-1), found.mean(axis=-1), peak=255),
    }
