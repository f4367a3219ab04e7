"""The scalar volumes on which peers are compared, those of OpenVDB too."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from _peers_method import Voxels
from volumes import source_crop, volumes

from octobrick.codec.errors import OctobrickError

TITLES = {
    "ct_bonsai": "bonsai CT",
    "ct_cranium": "cranium CT",
    "ct_vhf_head": "head CT",
    "em_fib25_train1": "electron microscopy",
    "fluor_mousebrain_u16": "fluorescence",
    "mra_avf_f32": "angiography",
    "mri_stroke_t1": "brain MR",
    "mri_vs_t1c": "head MR",
    "sim_heptane": "heptane",
    "sim_lcdm": "dark matter",
    "t010": "viscous flow",
    "vdb_wdas_cloud_sixteenth": "cloud",
}
"""What files of the shared folder are called; others keep their name."""


def peer_volumes(folder: Path, crop: int) -> Iterator[tuple[str, Voxels]]:
    """Title and central crop of every scalar volume."""
    for name, voxels in volumes(folder, crop):
        yield title(name), voxels
    for path in sorted(folder.glob("*.vdb")):
        try:
            yield title(path.name), source_crop(path, crop)
        except OctobrickError as error:
            print(f"!! {path.name} was not read: {error}", file=sys.stderr)


def title(name: str) -> str:
    """What a volume is called."""
    stem = name.partition(".")[0]
    return TITLES.get(stem, stem)
