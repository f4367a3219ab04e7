"""The stress report finds where promises break, and claims no more than it has tried."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.measure.extremes import StressRow, stress, table_rows, to_dict
from octobrick.measure.extremes.deblocking import deblocking_promises
from octobrick.measure.extremes.directions import gradient_promises
from octobrick.measure.extremes.pictures import PICTURE_PROMISES
from octobrick.measure.extremes.report import COLUMNS
from octobrick.measure.extremes.s3dc import s3dc_promises
from octobrick.measure.extremes.search import Promise, search
from octobrick.measure.extremes.zerobit import zerobit_promises


def fake(check: Any, *, start: float = 1.0, low: float = 1e-20, high: float = 1e20) -> Promise:
    return Promise("fake", "Python", "size", "it holds", 1.0, check, start, low, high)


@given(st.floats(2, 1e15), st.floats(1e-15, 0.5))
def test_a_promise_that_breaks_at_known_points_is_found_there(above: float, below: float) -> None:
    row = search(fake(lambda at: 0.5 if below <= at <= above else 2.0))
    assert row.held is not None
    low, high = row.held
    assert below <= low <= 1 <= high <= above
    # Six bisections of a step that is at most half of the way, in logarithms.
    assert math.log10(above / high) <= 10.5 / 64 + 1e-9
    assert math.log10(low / below) <= 10.5 / 64 + 1e-9
    assert row.first_failure is not None
    assert row.first_failure.count("at ") == 2


def test_no_more_is_claimed_than_was_tried() -> None:
    tried: list[float] = []

    def check(at: float) -> float:
        tried.append(at)
        return at / 1e21

    row = search(fake(check))
    assert row.held == row.tested == (min(tried), max(tried)) == (1e-20, 1e20)
    assert row.first_failure is None
    assert row.ok
    assert (row.worst, row.worst_at) == (pytest.approx(0.1), 1e20)
    assert row.ntried == len(tried) == len(set(tried))


def test_what_fails_beyond_is_in_tested_and_not_in_held() -> None:
    row = search(fake(lambda at: math.nan if at > 1e3 else 0.0))
    assert row.tested is not None
    assert row.held is not None
    assert row.held[1] <= 1e3 < row.tested[1]
    assert row.worst == 0
    assert "nan" in (row.first_failure or "")
    assert not row.ok


def test_a_promise_that_breaks_where_it_begins_is_held_nowhere() -> None:
    row = search(fake(lambda _: 7.0))
    assert row.held is None
    assert row.tested == (1.0, 1.0)
    assert row.first_failure == "at 1: 7"
    assert table_rows([row])[0][2] == "nowhere"


def test_an_error_of_octobrick_breaks_a_promise_and_is_told() -> None:
    def check(at: float) -> float:
        if at > 10:
            raise InvalidInputError("too large for this")
        return 0.0

    row = search(fake(check))
    assert "invalid-input: too large for this" in (row.first_failure or "")
    with pytest.raises(ZeroDivisionError):  # a bug is no finding
        search(fake(lambda _: 1 / 0))


def test_whole_numbers_are_bisected_to_neighbours() -> None:
    promise = Promise(
        "fake", "Python", "n", "it holds", 0.0, lambda n: float(n > 77), 1, 0, 90, "whole"
    )
    row = search(promise)
    assert row.held == (0, 77)
    assert row.first_failure == "at 78: 1"


class NoGraphics:
    def __init__(self) -> None:
        raise ResourceError("there is no OpenGL here")


def without_graphics(seed: int) -> tuple[StressRow, ...]:
    return stress(seed, make_scenes=NoGraphics)  # type: ignore[arg-type]


def test_without_opengl_the_renderers_rows_say_so_and_the_rest_is_the_same_each_time() -> None:
    shares: list[float] = []
    rows = stress(3, lambda _, share: shares.append(share), make_scenes=NoGraphics)  # type: ignore[arg-type]
    drawn = [row for row in rows if row.system == "renderer"]
    assert len(drawn) == len(PICTURE_PROMISES)
    assert all(row.note == "not run: no OpenGL (resource)" for row in drawn)
    assert not any(row.ok for row in drawn)
    assert shares == sorted(shares)
    assert 0 <= min(shares) <= max(shares) < 1
    document = to_dict(rows, 3)
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert to_dict(without_graphics(3), 3) == document
    assert all(len(cells) == len(COLUMNS) for cells in table_rows(rows))


def test_every_codec_has_rows_and_holds_where_it_begins() -> None:
    for make in (s3dc_promises, zerobit_promises, gradient_promises, deblocking_promises):
        promises = list(make(0))
        assert len(promises) >= 4
        for promise in promises:
            assert promise.low <= promise.start <= promise.high
            assert promise.check(promise.start) <= promise.tolerance, promise.parameter


@pytest.mark.gl
def test_the_whole_report_has_every_system_and_holds_what_is_documented() -> None:
    rows = {(row.system, row.parameter): row for row in stress()}
    systems = {system for system, _ in rows}
    assert systems == {
        "S3Dc", "S3Dc, bounded", "zerobit", "gradients", "deblocking", "renderer",
    }  # fmt: skip
    for (system, parameter), row in rows.items():
        assert row.held is not None, (system, parameter)
        assert row.worst is not None
        assert row.worst <= row.tolerance
        if system != "renderer":
            assert row.ok, (system, parameter, row.first_failure)
    for parameter, low, high in (
        ("step, voxels", 1 / 64, 4), ("zoom on a voxel", 1, 1e6),
        ("angle of view, degrees", 1e-6, 90), ("180° less the angle of view, degrees", 1e-3, 90),
        ("spacing z ÷ x", 1e-3, 1e3), ("float32 range of the volume", 1e-38, 3.4e38),
        ("opacity per voxel, steps of 0.5", 1e-9, 0.999),
    ):  # fmt: skip
        held = rows["renderer", parameter].held
        assert held is not None
        assert held[0] <= low
        assert held[1] >= high
