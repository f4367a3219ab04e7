"""What an ingest may keep in memory, and what goes to scratch files instead."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import grid_of
from octobrick.store.piece_reader import AHEAD
from octobrick.store.pyramid import PyramidPlan
from octobrick.store.window import ScratchWindow, Window, WindowShape, memory_window

_BASE_NBYTES = 112 * 2**20  # the interpreter and its libraries, and what sources and zstd cache
_SHARE_OF_SYSTEM = 0.5  # what an ingest takes of a machine's memory if it is not told
_PIECES = AHEAD + 2  # those read ahead, one in use, and one on its way to another type


@dataclass(frozen=True, slots=True)
class MemoryPlan:
    """Which windows of a pyramid are in memory.

    Attributes:
        limit_nbytes: of the whole process, about.
        scratch: arrays whose windows lie in scratch files.
        nbytes: what the process will take.
    """

    limit_nbytes: int
    scratch: frozenset[str]
    nbytes: int

    def window(self, folder: Path, array: str, shape: WindowShape) -> Window:
        """The window of an array, a scratch file of which lies in the folder."""
        if array in self.scratch:
            return ScratchWindow(*shape, folder)
        return memory_window(array, shape)


def plan_memory(
    plan: PyramidPlan,
    *,
    nt: int,
    nc: int,
    nworkers: int,
    piece_nbytes: int,
    limit_nbytes: int | None,
) -> MemoryPlan:
    """Keep as many windows in memory as the limit allows; the largest go to scratch files first.

    Args:
        plan: what is made of each channel.
        nt: time steps, whose ranges and errors are all remembered.
        nc: channels, each of which has windows of its own.
        nworkers: encoding threads.
        piece_nbytes: what is read at a time, of all channels.
        limit_nbytes: by default half of the memory that the system gives this process.

    Raises:
        InvalidInputError: the limit is below what the least takes.
    """
    limit = limit_nbytes or int(system_nbytes() * _SHARE_OF_SYSTEM)
    fixed = _BASE_NBYTES + _PIECES * piece_nbytes + _work_nbytes(plan, nworkers)
    fixed += nt * nc * _tables_nbytes(plan)
    windows = plan.window_shapes()
    kept = sum(window.nbytes for window in windows.values())
    scratch: set[str] = set()
    rows = 0  # of one array at a time
    for array in sorted(windows, key=lambda name: windows[name].nbytes, reverse=True):
        own_rows = max(rows, _rows_nbytes(plan, windows[array]))
        pays = nc * windows[array].nbytes > own_rows - rows
        if fixed + nc * kept + rows > limit and pays:
            scratch.add(array)
            kept, rows = kept - windows[array].nbytes, own_rows
    total = fixed + nc * kept + rows
    if total > limit and limit_nbytes is not None:
        raise InvalidInputError(
            f"memory {limit_nbytes}: this volume takes at least {total} bytes (--memory "
            f"{-(-total // 2**20)}MiB); allow that much, or choose smaller bricks or fewer workers",
            memory=limit_nbytes,
            least_nbytes=total,
        )
    return MemoryPlan(limit, frozenset(scratch), total)


def system_nbytes() -> int:
    """The memory that this process can have: of the machine, or of its control group."""
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    try:
        text = Path("/sys/fs/cgroup/memory.max").read_text().strip()
    except OSError:
        return machine
    return min(machine, int(text)) if text.isdecimal() else machine


def _rows_nbytes(plan: PyramidPlan, window: WindowShape) -> int:
    """What is in memory of a window that lies in a file: two rows of bricks."""
    row_nbytes = window.nbytes // (window.nplanes * window.row_shape[0])
    side = plan.brick + 2
    return 2 * row_nbytes * min(side, window.nplanes) * min(side, window.row_shape[0])


def _work_nbytes(plan: PyramidPlan, nworkers: int) -> int:
    """What bricks take that are being encoded, or wait for the rest of their row."""
    nvoxels, itemsize = plan.brick**3, plan.dtype.itemsize
    has_gradients = plan.directions is not None
    worked_nbytes = 4 * itemsize + (6 if has_gradients else 0)  # float32 at half resolution
    waiting_nbytes = itemsize * 9 / 8 + (3 / 7 if has_gradients else 0)  # and what it is reduced to
    nrow = -(-plan.shapes_zyx[0][2] // plan.brick)
    return int(nvoxels * (nworkers * worked_nbytes + (plan.nahead + nrow) * waiting_nbytes))


def _tables_nbytes(plan: PyramidPlan) -> int:
    """Ranges and fidelity of all levels."""
    per_brick = 2 * (plan.dtype.itemsize + np.dtype(np.float32).itemsize)
    grids = (grid_of(shape, (plan.brick,) * 3) for shape in plan.shapes_zyx)
    return sum(per_brick * nz * ny * nx for nz, ny, nx in grids)
