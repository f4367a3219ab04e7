"""Frames of a DICOM series in order: where each lies, how far apart they are, how they are turned.

Frames are sorted by their position along the normal of the plane, never by name or number: scanners
number them in either direction, and archives rename files.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from octobrick.store.errors import SourceError
from octobrick.store.sources.base import Direction, Vector
from octobrick.store.sources.dicom_file import Frame
from octobrick.store.sources.voxels import clean_spacing, direction_of

# A gap of nearly two distances means that a frame is missing; less is how scanners round.
_GAP_RATIO = 1.9
_UNEVEN_RATIO = 0.01
_SAME_POSITION = 1e-3
_SAME_DIRECTION = 1e-3


@dataclass(frozen=True, slots=True)
class Stack:
    """The planes of a volume: frame ``frames[t][z]``; lengths in millimetres where known."""

    frames: tuple[tuple[Frame, ...], ...]
    spacing_zyx: Vector
    has_unit: bool
    direction: Direction | None
    origin_xyz: Vector


def stack_frames(path: Path, frames: Sequence[Frame], notes: list[str]) -> Stack:
    """Frames by time step and z.

    Args:
        path: the folder, pattern or file, for messages.
        frames: those of one series, in any order.
        notes: takes a sentence for whatever is uneven or lacking.

    Raises:
        SourceError: frames that differ from the first, are missing, or lie at one place without
            being time steps.
    """
    first = frames[0]
    for frame in frames:
        _require_alike(frame, first)
    spacing_yx = first.spacing_yx or (1.0, 1.0)
    if first.spacing_yx is None:
        notes.append("the files do not say how far pixels are apart; 1 is used")
    if any(frame.position_xyz is None or frame.row_xyz is None for frame in frames):
        if len(frames) > 1:
            notes.append("frames without a position are in the order of their numbers")
        ordered = tuple(sorted(frames, key=lambda frame: frame.order))
        size_z = first.thickness or 1.0
        spacing = clean_spacing([spacing_yx[1], spacing_yx[0], size_z], notes)
        return Stack((ordered,), spacing, first.spacing_yx is not None, None, (0.0, 0.0, 0.0))
    planes = _planes(path, frames)
    positions = np.array([plane[0].position_xyz for plane in planes])
    normal = np.cross(_known(first.row_xyz), _known(first.column_xyz))
    step, size_z = normal, first.thickness or 1.0
    if len(planes) > 1:
        _require_even(path, planes, positions @ normal, notes)
        step = (positions[-1] - positions[0]) / (len(planes) - 1)
        size_z = float(np.linalg.norm(step))
        if step @ normal < size_z * 0.9999:
            notes.append("planes are shifted against each other (a tilted gantry); z is their axis")
    axes = (_known(first.row_xyz), _known(first.column_xyz), tuple(float(s) for s in step))
    return Stack(
        tuple(zip(*planes, strict=True)),
        clean_spacing([spacing_yx[1], spacing_yx[0], size_z], notes),
        has_unit=True,
        direction=direction_of(axes, notes),
        origin_xyz=_known(planes[0][0].position_xyz),
    )


def _planes(path: Path, frames: Sequence[Frame]) -> list[list[Frame]]:
    """The frames at each place along the normal, upwards; those at one place by their numbers."""
    normal = np.cross(_known(frames[0].row_xyz), _known(frames[0].column_xyz))
    along = [float(np.dot(_known(frame.position_xyz), normal)) for frame in frames]
    planes: list[list[Frame]] = []
    last = -np.inf
    for i in np.argsort(along, kind="stable"):
        if along[i] - last > _SAME_POSITION:
            planes.append([])
            last = along[i]
        planes[-1].append(frames[i])
    for plane in planes:
        plane.sort(key=lambda frame: frame.order)
        if len(plane) != len(planes[0]):
            raise SourceError(
                f"{path}: {len(planes[0])} frames lie at {planes[0][0].position_xyz}, but "
                f"{len(plane)} at {plane[0].position_xyz} ({plane[0].stored.path.name}); a volume "
                "with time steps has as many everywhere: leave out those too many",
                path=str(path),
                file=plane[0].stored.path.name,
            )
    return planes


def _require_even(
    path: Path, planes: list[list[Frame]], along: np.ndarray, notes: list[str]
) -> None:
    gaps = np.diff(along)
    usual = float(np.median(gaps))
    widest = int(np.argmax(gaps))
    if gaps[widest] > _GAP_RATIO * usual:
        below, above = planes[widest][0].stored.path, planes[widest + 1][0].stored.path
        raise SourceError(
            f"{path}: {gaps[widest]:g} mm lie between {below.name} and {above.name}, elsewhere "
            f"{usual:g}: frames are missing; copy the series again",
            path=str(path),
            gap=float(gaps[widest]),
            usual=usual,
        )
    if np.abs(gaps - usual).max() > _UNEVEN_RATIO * usual:
        notes.append(
            f"frames are {gaps.min():g} to {gaps.max():g} mm apart; their mean distance is used"
        )


def _require_alike(frame: Frame, first: Frame) -> None:
    """Refuse a frame of another size, type or orientation than the first."""
    for what, own, other in (
        ("pixels", frame.pixels, first.pixels),
        ("a pixel spacing", frame.spacing_yx, first.spacing_yx),
        ("rows along", frame.row_xyz, first.row_xyz),
        ("columns along", frame.column_xyz, first.column_xyz),
    ):
        same = own == other
        if not same and isinstance(own, tuple) and isinstance(other, tuple):
            same = bool(np.allclose(own, other, rtol=0, atol=_SAME_DIRECTION))
        if not same:
            raise SourceError(
                f"{frame.stored.path}: has {what} {own}, but {first.stored.path.name} has {other}; "
                "the frames of a series must be alike: leave out the file (a scout, perhaps)",
                path=str(frame.stored.path),
                first=first.stored.path.name,
            )


def _known(vector: Vector | None) -> Vector:
    assert vector is not None
    return vector
