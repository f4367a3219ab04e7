"""What stays in memory, and what goes to scratch files."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError
from octobrick.store.brick_encoder import BrickEncoder, DirectionEncoder
from octobrick.store.memory_plan import MemoryPlan, plan_memory, system_nbytes
from octobrick.store.pyramid import PyramidPlan
from octobrick.store.reducers import level_shapes
from octobrick.store.window import ScratchWindow, memory_window

MIB = 2**20
SHAPES = level_shapes((1024, 4096, 2048), 64)
PLAN = PyramidPlan(
    shapes_zyx=SHAPES,
    dtype=np.dtype(np.uint16),
    encoders=[BrickEncoder(None, 64, 1)] * len(SHAPES),
    reducer="mean",
    spacing_zyx=(1.0, 1.0, 1.0),
    directions=DirectionEncoder(64, 1),
    source_nplanes=1,
    make_window=memory_window,
    nahead=8,
)


def planned(
    limit_nbytes: int | None, plan: PyramidPlan = PLAN, nc: int = 1, nt: int = 1
) -> MemoryPlan:
    return plan_memory(
        plan, nt=nt, nc=nc, nworkers=2, piece_nbytes=16 * MIB, limit_nbytes=limit_nbytes
    )


def test_the_largest_windows_go_to_files_until_the_rest_fits() -> None:
    windows = PLAN.window_shapes()
    largest = sorted(windows, key=lambda name: windows[name].nbytes, reverse=True)
    assert largest[0] == "0"
    seen = []
    for limit in range(4096 * MIB, 600 * MIB, -64 * MIB):
        plan = planned(limit)
        assert plan.nbytes <= limit
        assert plan.scratch == set(largest[: len(plan.scratch)])
        seen.append(len(plan.scratch))
    assert seen == sorted(seen)
    assert (seen[0], seen[-1] > 1) == (0, True)


def test_less_than_the_least_is_refused_and_the_least_will_do() -> None:
    with pytest.raises(InvalidInputError, match="takes at least") as refused:
        planned(1)
    least = refused.value.facts["least_nbytes"]
    assert isinstance(least, int)
    assert planned(least).nbytes <= least
    with pytest.raises(InvalidInputError):
        planned(least - 1)


def test_every_channel_has_windows_of_its_own() -> None:
    assert planned(2**40, nc=3).nbytes > planned(2**40).nbytes + sum(
        window.nbytes for window in PLAN.window_shapes().values()
    )


def test_ranges_and_errors_of_all_time_steps_are_counted() -> None:
    nbricks = sum(math.prod(-(-n // 64) for n in shape) for shape in SHAPES)
    more = planned(2**40, nt=11).nbytes - planned(2**40).nbytes
    assert more == 10 * nbricks * (2 * 2 + 2 * 4)  # two uint16, two float32


def test_unless_told_otherwise_it_is_half_of_what_the_system_has() -> None:
    assert planned(None).limit_nbytes == system_nbytes() // 2 > 0


def test_without_gradients_none_are_planned_for() -> None:
    plain = dataclasses.replace(PLAN, directions=None)
    assert not [name for name in plain.window_shapes() if name.startswith("gradient")]
    assert planned(2**40, plain).nbytes < planned(2**40).nbytes


def test_windows_are_made_where_the_plan_says(tmp_path: Path) -> None:
    plan, shape = planned(1024 * MIB), PLAN.window_shapes()["0"]
    assert isinstance(plan.window(tmp_path, "0", shape._replace(nplanes=1)), ScratchWindow)
    coarsest = str(len(SHAPES) - 1)
    assert not isinstance(plan.window(tmp_path, coarsest, shape._replace(nplanes=1)), ScratchWindow)
