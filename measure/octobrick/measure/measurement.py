"""What `measure` found, as values: rows of figures, and what follows from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from octobrick.codec.metrics import Histogram
from octobrick.store.brick_codec import BrickCodec, codec_to_json

VERSION = 1
"""Of what `Measurement.to_dict` gives; a field that is added does not change it."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One way to store a volume's bricks.

    Attributes:
        label: for people: "S3Dc 4 bits, 8³".
        family: what belongs on one curve: "S3Dc, fixed 8³".
        codec: of a brick; None keeps voxels as they are.
        flags: of `octobrick ingest`, which make a volume so.
    """

    label: str
    family: str
    codec: BrickCodec
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CodeRow:
    """A setting on the sampled bricks, weighted so that it stands for level 0 of the whole.

    Attributes:
        setting: that was measured.
        resident_bits: of a code in memory, per voxel; 8 × bytes / voxels, without padding voxels.
        disk_bits: the same behind zstd, as it is stored.
        psnr_db: over the range of the whole volume; None where nothing was lost.
        ssim: mean structural similarity of the middle of bricks; 1 where nothing was lost, NaN
            where no brick holds a window of 11³ voxels.
        max_error: greatest difference of a decoded from an original voxel, in values.
        rmse: in values.
        errors: histogram of absolute differences, in values.
        encode_voxels_per_second, decode_voxels_per_second: medians, of one thread.
    """

    setting: Setting
    resident_bits: float
    disk_bits: float
    psnr_db: float | None
    ssim: float
    max_error: float
    rmse: float
    errors: Histogram
    encode_voxels_per_second: float
    decode_voxels_per_second: float


@dataclass(frozen=True, slots=True)
class LevelRow:
    """What seeing a coarser level instead of level 0 costs, before any code.

    Attributes:
        level: of the pyramid.
        psnr_db, max_error, rmse: of the level, spread to level 0's voxels by trilinear
            interpolation, against level 0.
    """

    level: int
    psnr_db: float | None
    max_error: float
    rmse: float


@dataclass(frozen=True, slots=True)
class PictureRow:
    """One way to draw one setting, over all views.

    Attributes:
        setting: how the bricks were stored.
        path: how they were drawn: "slab", "slab, deblocked", "direct, linear", ….
        render_flags: of `octobrick render`, which draw so.
        frame_seconds: median of a frame with all bricks in memory.
        frame_seconds_quartiles: lower and upper, over views and repetitions.
        psnr_db, ssim: of all views' pixels against the uncompressed volume by the reference path;
            colours against 255; None where equal.
        psnr_db_by_view: likewise, one for each view.
        differences: key of `Measurement.pictures`, one for each view, in the S3Dc paper's colours.
    """

    setting: Setting
    path: str
    render_flags: tuple[str, ...]
    frame_seconds: float
    frame_seconds_quartiles: tuple[float, float]
    psnr_db: float | None
    ssim: float
    psnr_db_by_view: tuple[float | None, ...]
    differences: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Recommendation:
    """What to do for a target.

    Attributes:
        target: as it was asked: "psnr=45".
        met: whether something that was measured meets it.
        setting: the cheapest that does, or what comes nearest.
        reason: one sentence with the figures that decided.
        ingest_command, render_command: exactly what to run; the second only where drawing was
            part of the target.
    """

    target: str
    met: bool
    setting: Setting
    reason: str
    ingest_command: str
    render_command: str | None = None


@dataclass(frozen=True, slots=True)
class Measurement:
    """All that one run measured. `to_dict` is JSON-ready; pictures go beside it, by their keys.

    Attributes:
        source: what was measured: name, format, sample type, shape_zyx, spacing, range, and
            whether the range is that of all voxels or of those that were read.
        options: with which it can be run again, the seed among them.
        sample: the bricks: how many of how many, by stratum, and their share of voxels.
        machine: processors, OpenGL device, versions, date.
        codes, levels, pictures: the rows.
        front: labels of the settings that no other beats in both bits on disk and PSNR.
        recommendations: one for each target.
        skipped: what the time limit left out, for people.
        elapsed_seconds: of the run.
        images: PNG bytes by key: "view-0", "slab-…-view-0-difference".
    """

    source: dict[str, Any]
    options: dict[str, Any]
    sample: dict[str, Any]
    machine: dict[str, Any]
    codes: tuple[CodeRow, ...]
    levels: tuple[LevelRow, ...]
    pictures: tuple[PictureRow, ...]
    front: tuple[str, ...]
    recommendations: tuple[Recommendation, ...]
    skipped: tuple[str, ...]
    elapsed_seconds: float
    images: dict[str, bytes] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready: None for a PSNR where nothing was lost, and for what cannot be told."""
        return {
            "version": VERSION,
            "source": _plain(self.source),
            "options": _plain(self.options),
            "sample": _plain(self.sample),
            "machine": _plain(self.machine),
            "codes": [_row(row) for row in self.codes],
            "levels": [_row(row) for row in self.levels],
            "pictures": [_row(row) for row in self.pictures],
            "front": list(self.front),
            "recommendations": [_row(one) for one in self.recommendations],
            "skipped": list(self.skipped),
            "elapsed_seconds": _plain(self.elapsed_seconds),
            "images": sorted(self.images),
        }


def setting_to_dict(setting: Setting) -> dict[str, Any]:
    """A setting as JSON-ready values."""
    return {
        "label": setting.label,
        "family": setting.family,
        "codec": codec_to_json(setting.codec),
        "flags": list(setting.flags),
    }


def _row(row: CodeRow | LevelRow | PictureRow | Recommendation) -> dict[str, Any]:
    """A row by its fields; how it was stored under "setting"."""
    return {field.name: _plain(getattr(row, field.name)) for field in fields(row)}


def _plain(value: Any) -> Any:
    """As JSON takes it: None for a number that is none."""
    match value:
        case Setting():
            return setting_to_dict(value)
        case Histogram():
            return {"low": value.low, "width": value.width, "counts": value.counts.tolist()}
        case dict():
            return {str(key): _plain(one) for key, one in value.items()}
        case list() | tuple():
            return [_plain(one) for one in value]
        case float():
            return float(value) if math.isfinite(value) else None
        case np.generic():
            return _plain(value.item())
        case _:
            return value
