"""Volumes of compressed bricks on disk: ingest them, open them, read them.

The names listed in ``__all__`` are the component's promise; everything else may change.
"""

from octobrick.store.box import Box, Zyx
from octobrick.store.camera_grid import CameraGrid, CameraStep
from octobrick.store.export import ExportResult, export
from octobrick.store.ingest import ingest
from octobrick.store.level import Level
from octobrick.store.local_volume import LocalVolume
from octobrick.store.opening import open_volume
from octobrick.store.progress import Progress
from octobrick.store.report import IngestResult, LevelReport
from octobrick.store.surface import Mesh, Placement, read_mesh
from octobrick.store.synth import SynthResult, synth
from octobrick.store.volume import Volume

__all__ = [
    "Box",
    "CameraGrid",
    "CameraStep",
    "ExportResult",
    "IngestResult",
    "Level",
    "LevelReport",
    "LocalVolume",
    "Mesh",
    "Placement",
    "Progress",
    "SynthResult",
    "Volume",
    "Zyx",
    "export",
    "ingest",
    "open_volume",
    "read_mesh",
    "synth",
]
