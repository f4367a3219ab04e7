"""NanoVDB's quantized grids as peers, through the command nanovdb_convert.

The tool works on files and has threads; it is kept on one processor, and its times have starting,
reading and writing in them. Voxels are judged as the tool itself gives them back, and must be those
that octobrick reads from the quantized file.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
from _peers_method import (
    Calls,
    Method,
    NotRunError,
    Voxels,
    behind_zstd,
    contiguous,
    value_range,
)
from _peers_ours import BOUNDS

from octobrick.store.box import Box
from octobrick.store.sources import open_source
from octobrick.store.vdb_writer import write_vdb

PROGRAM, PACKAGE = "nanovdb_convert", "libnanovdb-tools"
LEAF = 8
_LIMIT_SECONDS = 600


class _NanoVdb:
    """A volume as an OpenVDB file, and its conversions."""

    def __init__(self, options: list[str], voxels: Voxels, folder: Path) -> None:
        self._program = shutil.which(PROGRAM) or ""
        if not self._program:
            raise NotRunError(f"not run: install {PACKAGE}")
        self._options, self._voxels, self._folder = options, voxels, folder
        self._background, self._given = _as_vdb(voxels, folder / "given.vdb")

    def encode(self) -> Path:
        return self._convert(self._given, "code.nvdb", *self._options)

    def decode(self, code: Path) -> Path:
        return self._convert(code, "decoded.vdb")

    def voxels(self, decoded: Path) -> Voxels:
        return self._read(decoded)

    def sizes(self, code: Path) -> tuple[int, int]:
        """On disk the smaller of its own packing and zstd."""
        by_tool, by_us = self._read(self.decode(code)), self._read(code)
        if not np.array_equal(by_tool, by_us):
            worst = float(np.abs(by_tool - by_us).max())
            raise RuntimeError(f"octobrick reads this grid otherwise than its tool, by {worst}")
        packed = self._convert(self._given, "packed.nvdb", *self._options, "--zip")
        nbytes = code.stat().st_size
        return nbytes, min(packed.stat().st_size, behind_zstd(code.read_bytes()))

    def _convert(self, source: Path, name: str, *options: str) -> Path:
        made = self._folder / name
        command = [self._program, "--force", *options, str(source), str(made)]
        ran = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=_LIMIT_SECONDS,
            check=False,
            preexec_fn=_stay_on_one_processor,
        )
        if ran.returncode or not made.exists():
            said = (ran.stderr or ran.stdout).strip() or "it said nothing"
            raise RuntimeError(f"{PROGRAM} ended with status {ran.returncode}: {said[:200]}")
        return made

    def _read(self, path: Path) -> Voxels:
        """The grid where it was put; around its active voxels is background."""
        padded = np.full(_padded(self._voxels).shape, self._background, np.float32)
        with open_source(path) as source:
            x, y, z = (round(at) for at in source.origin_xyz)
            nz, ny, nx = source.shape_zyx
            padded[z : z + nz, y : y + ny, x : x + nx] = source.read(
                Box((0, 0, 0), source.shape_zyx)
            )
        nz, ny, nx = self._voxels.shape
        floats = padded[:nz, :ny, :nx]
        dtype = self._voxels.dtype
        if dtype.kind == "f":
            return floats.astype(dtype)
        info = np.iinfo(dtype)
        rounded = np.floor(floats.astype(np.float64) + 0.5)
        return np.clip(rounded, info.min, info.max).astype(dtype)


def _stay_on_one_processor() -> None:
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def _padded(voxels: Voxels) -> Voxels:
    """Whole leaves, with the last voxels repeated, so that nothing widens their ranges."""
    return np.pad(voxels, [(0, -n % LEAF) for n in voxels.shape], mode="edge")


def _as_vdb(voxels: Voxels, path: Path) -> tuple[float, Path]:
    """Writes a grid of floats; where the commonest value is the least, it is left out.

    Returns:
        The background, and the file.
    """
    padded = _padded(voxels).astype(np.float32)
    values, counts = np.unique(padded, return_counts=True)
    background = float(values[counts.argmax()])
    is_least = background == values[0] and values.size > 1
    active = (float(values[1]), float(values[-1])) if is_least else None
    write_vdb(path, [((0, 0, 0), padded)], dtype="float32", active=active, background=background)
    return background, path


def _ready(options: list[str], voxels: Voxels, folder: Path) -> Calls:
    return _NanoVdb(options, contiguous(voxels), folder)


def _ready_bound(share: float, voxels: Voxels, folder: Path) -> Calls:
    options = ["--fpN", "--abs-error", repr(share * value_range(voxels))]
    return _NanoVdb(options, contiguous(voxels), folder)


def methods() -> list[Method]:
    """4 and 8 bits, and as many bits as each of our bounds takes."""
    found = [
        Method(f"NanoVDB Fp{bits}", "NanoVDB Fp", "voxel", partial(_ready, [f"--fp{bits}"]))
        for bits in (4, 8)
    ]
    return found + [
        Method(f"NanoVDB FpN {100 * b:g} %", "NanoVDB FpN", "voxel", partial(_ready_bound, b))
        for b in BOUNDS
    ]
