from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError, NotFoundError, UnsupportedError
from octobrick.renderer import TransferFunction
from octobrick.renderer.classifier import Classifier, ValueScale, checked_window
from octobrick.renderer.modes import MODES

WHITE = ((0.0, (1.0, 1.0, 1.0)),)
unit = st.floats(0, 1, allow_subnormal=False)


@st.composite
def functions(draw: st.DrawFn, domain: str | None = None) -> TransferFunction:
    domain = domain or draw(st.sampled_from(["relative", "value"]))
    at = unit if domain == "relative" else st.floats(-2000, 70000)
    colors = draw(st.lists(st.tuples(at, st.tuples(unit, unit, unit)), min_size=1, max_size=6))
    points = draw(st.lists(st.tuples(at, st.sampled_from([0.0, 0.0, 0.5]) | unit), min_size=1))
    return TransferFunction(
        tuple(sorted(colors, key=lambda p: p[0])),
        tuple(sorted(points, key=lambda p: p[0])),
        domain,  # type: ignore[arg-type]
        draw(st.sampled_from(["voxel", "extent"])),
    )


@given(functions())
def test_json_makes_an_equal_function(function: TransferFunction) -> None:
    assert TransferFunction.from_json(function.to_json()) == function


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"colors": [[0, 1, 1, 1]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, 1]], "name": "x"}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, 1]], "octobrick_transfer_function": 2}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, 1]], "domain": "hounsfield"}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, 1]], "opacity_unit": 3}',
        '{"colors": [[0, 1, 1]], "opacities": [[0, 1]]}',
        '{"colors": [], "opacities": [[0, 1]]}',
        '{"colors": {"0": 1}, "opacities": [[0, 1]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, true]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, "1"]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, NaN]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, 1e999]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, 1.5]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, -0.1]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[1.1, 0.1]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0.6, 0.1], [0.5, 0.1]]}',
        '{"colors": [[0, 1, 1, 1]], "opacities": [[0, 1]]' + "[" * 100_000,
        '{"colors": [[0, 1, 1, 1]], "opacities": [' + "[0, 1]," * 5000 + "[0, 1]]}",
    ],
)
def test_json_that_is_no_function_is_refused(text: str) -> None:
    with pytest.raises(InvalidInputError, match="transfer function"):
        TransferFunction.from_json(text)


def test_fields_with_defaults_may_be_left_out() -> None:
    function = TransferFunction.from_json('{"colors": [[0, 1, 1, 1]], "opacities": [[0.5, 1]]}')
    assert function == TransferFunction(WHITE, ((0.5, 1.0),))


@pytest.mark.parametrize("name", TransferFunction.preset_names())
def test_presets_are_transparent_below_their_first_point(name: str) -> None:
    function = TransferFunction.preset(name)
    assert function.opacities[0][1] == 0
    assert function.table(64)[0, 3] == 0
    assert function.table(64)[-1, 3] > 0.3
    assert TransferFunction.from_json(function.to_json()) == function


def test_presets_are_those_promised() -> None:
    assert TransferFunction.preset_names() == ["ct-bone", "ct-soft-tissue", "microscopy", "mr"]
    with pytest.raises(NotFoundError, match="ct-bone"):
        TransferFunction.preset("../ct-bone")


def test_points_make_the_same_function_as_two_lists() -> None:
    points = [(0.0, (0.0, 0.0, 0.0), 0.0), (200.0, (1.0, 0.5, 0.0), 0.25)]
    function = TransferFunction.from_points(points, domain="value")
    assert function.colors == ((0.0, (0.0, 0.0, 0.0)), (200.0, (1.0, 0.5, 0.0)))
    assert function.opacities == ((0.0, 0.0), (200.0, 0.25))


@given(functions(), st.integers(2, 300))
def test_table_is_linear_between_points_and_constant_beyond(
    function: TransferFunction, n: int
) -> None:
    table = function.table(n).astype(np.float64)
    low, high = function.value_domain((0.0, 1.0))
    at = np.linspace(low, high, n)
    positions = np.array([p for p, _ in function.opacities])
    # Away from steps and from the entries that a peak may have raised, np.interp agrees.
    spacing = (high - low) / (n - 1)
    clear = np.abs(at[:, None] - positions).min(axis=1) > 0.51 * spacing
    wanted = np.interp(at, positions, [a for _, a in function.opacities])
    np.testing.assert_allclose(table[clear, 3], wanted[clear], atol=1e-6)


@given(functions(), st.floats(1e-4, 20))
def test_table_is_premultiplied_and_corrected_for_the_step(
    function: TransferFunction, ratio: float
) -> None:
    whole, part = (function.table(64, r).astype(np.float64) for r in (1.0, ratio))
    assert ((part >= 0) & (part <= 1)).all()
    assert (part[:, :3] <= part[:, 3:] + 1e-6).all()
    wanted = 1 - (1 - whole[:, 3]) ** ratio
    sound = whole[:, 3] <= 0.99  # nearer to 1, float32 does not say how much is left
    np.testing.assert_allclose(part[sound, 3], wanted[sound], rtol=2e-5, atol=1e-6)
    normal = whole[:, 3] > 1e-30  # smaller ones may vanish in float32, and cannot be seen
    assert (part[normal, 3] > 0).all()
    np.testing.assert_array_equal(whole[:, 3] == 1, function.table(64, 0.5)[:, 3] == 1)


def test_correction_is_exact_for_small_opacities() -> None:
    table = TransferFunction(WHITE, ((0.0, 1e-12),)).table(2, 0.25)
    np.testing.assert_allclose(table[:, 3], 0.25e-12, rtol=1e-6)


def test_step_counts_from_its_position_on() -> None:
    table = TransferFunction(WHITE, ((0.25, 0.1), (0.5, 0.1), (0.5, 0.7), (1.0, 0.7))).table(9)
    np.testing.assert_allclose(table[:, 3], [0.1] * 4 + [0.7] * 5, atol=1e-7)


@given(unit, st.floats(0.01, 1), st.integers(2, 50))
def test_peak_of_no_width_is_kept(at: float, height: float, n: int) -> None:
    function = TransferFunction(WHITE, ((at, 0.0), (at, height), (at, 0.0)))
    table = function.table(n)
    assert table[:, 3].max() == np.float32(height)
    assert abs(table[:, 3].argmax() / (n - 1) - at) <= 0.5 / (n - 1) + 1e-9


def test_values_at_one_point_only_make_a_step_there() -> None:
    function = TransferFunction(((7.0, (1.0, 1.0, 1.0)),), ((7.0, 0.0), (7.0, 1.0)), "value")
    low, high = function.value_domain((0, 1))
    assert low < 7 < high
    table = function.table(101)
    assert (table[:50, 3] == 0).all()
    assert (table[50:, 3] == 1).all()


def test_reference_length_is_a_voxel_or_a_part_of_the_extent() -> None:
    by_voxel = TransferFunction(WHITE, ((0.0, 0.5),))
    by_extent = TransferFunction(WHITE, ((0.0, 0.5),), opacity_unit="extent")
    shape, spacing = (100, 512, 256), (0.5, 0.25, 2.0)
    assert by_voxel.reference_length_world(spacing, shape) == 0.25
    assert by_extent.reference_length_world(spacing, shape) == 200 / 256
    halved = tuple(2 * s for s in spacing), tuple(n // 2 for n in shape)
    assert by_extent.reference_length_world(*halved) == 200 / 256


@pytest.mark.parametrize(
    ("dtype", "value_range", "wanted"),
    [
        ("uint8", (3, 90), (0, 255)),
        ("int8", (3, 90), (-128, 127)),
        ("uint16", (3, 90), (0, 65535)),
        ("int16", (-5, 90), (-32768, 32767)),
        ("float32", (-0.5, 90.25), (-0.5, 90.25)),
    ],
)
def test_stored_values_cover_the_type(dtype: str, value_range: Any, wanted: Any) -> None:
    scale = ValueScale.of(np.dtype(dtype), value_range)
    assert (scale.lowest, scale.highest) == wanted
    assert scale.to_stored(wanted[0]) == 0
    assert scale.to_stored(wanted[1]) == 1


@pytest.mark.parametrize("dtype", ["float64", "uint32", "bool", "complex64"])
def test_types_that_no_texture_holds_are_refused(dtype: str) -> None:
    with pytest.raises(UnsupportedError, match=dtype):
        ValueScale.of(np.dtype(dtype), (0, 1))


@given(
    functions(),
    st.lists(st.floats(-3000, 70000), min_size=2, max_size=2).map(sorted),
    st.sampled_from([(0.0, 1.0), (-1024.0, 1500.0), (100.0, 50000.0)]),
    st.lists(unit, min_size=1, max_size=30),
)
@settings(max_examples=150)
def test_what_culling_drops_is_transparent_in_the_shader(
    function: TransferFunction, bounds: list[float], window: tuple[float, float], mix: list[float]
) -> None:
    """The shader's arithmetic, in float32: any value of a range that is dropped has opacity 0."""
    scale = ValueScale.of(np.dtype(np.int16), (0, 0))
    classifier = Classifier(function, scale, window, 0.5)
    low, high = (min(max(b, -32768.0), 32767.0) for b in bounds)
    values = np.array([low, high, *(low + (high - low) * m for m in mix)]).clip(low, high)
    stored = ((values - scale.lowest) / scale.width).astype(np.float32)
    entry = stored * np.float32(classifier.entries_per_stored) + np.float32(
        classifier.entry_of_stored_zero
    )
    n = len(classifier.table)
    below = np.clip(np.floor(entry), 0, n - 1).astype(int)
    above = np.clip(np.floor(entry) + 1, 0, n - 1).astype(int)
    seen = (classifier.table[below, 3] > 0) | (classifier.table[above, 3] > 0)
    if seen.any():
        assert classifier.visible(np.array(low), np.array(high))


@given(
    functions(),
    st.lists(st.tuples(st.floats(-9000, 90000), st.floats(0, 20000)), min_size=1, max_size=20),
    st.sampled_from([(0.0, 1.0), (-1024.0, 1500.0), (100.0, 50000.0)]),
    st.sampled_from(["dvr", "mip", "minip"]),
)
def test_a_range_is_visible_if_an_entry_that_it_touches_is(
    function: TransferFunction,
    ranges: list[tuple[float, float]],
    window: tuple[float, float],
    mode: str,
) -> None:
    scale = ValueScale.of(np.dtype(np.int16), (0, 0))
    classifier = Classifier(function, scale, window, 0.5, MODES[mode])
    low = np.array([start for start, _ in ranges])
    high = low + [length for _, length in ranges]
    found = classifier.visible(low, high)
    n, margin = len(classifier.table), classifier.entry_margin
    for i, (start, stop) in enumerate(zip(low, high, strict=True)):
        first, last = (
            (value - scale.lowest) / scale.width * classifier.entries_per_stored
            + classifier.entry_of_stored_zero
            for value in (start, stop)
        )
        slack = 1e-6 * (abs(first) + abs(last) + 1)  # of two ways to the same number
        inner, outer = (
            classifier.table[
                0 if mode == "mip" else min(max(math.floor(first - margin - s), 0), n - 1) :
                n if mode == "minip" else min(max(math.ceil(last + margin + s), 0), n - 1) + 1,
                3,
            ]
            for s in (-slack, slack)
        )  # fmt: skip
        assert (inner > 0).any() <= found[i] <= (outer > 0).any()


def test_range_beside_a_transparent_band_is_dropped() -> None:
    function = TransferFunction(WHITE, ((0.4, 0.0), (0.5, 1.0), (0.6, 0.0)))
    classifier = Classifier(function, ValueScale(0, 255), (0, 255), 1.0)
    ranges = np.array([(0, 100), (0, 103), (150, 152), (155, 255), (0, 255)])
    found = classifier.visible(ranges[:, 0], ranges[:, 1])
    assert found.tolist() == [False, True, True, False, True]
    assert not classifier.empty
    assert Classifier(TransferFunction(WHITE, ((0, 0.0),)), ValueScale(0, 255), (0, 9), 1).empty


def test_window_defaults_to_the_volumes_own_and_is_never_flat() -> None:
    assert checked_window(None, (3, 90)) == (3, 90)
    low, high = checked_window(None, (7, 7))
    assert low == 7 < high
    assert checked_window((1, 2.5), (3, 90)) == (1, 2.5)


@pytest.mark.parametrize("window", [(1, 1), (2, 1), (math.nan, 1), (0, math.inf), (1,), "ab", 3])
def test_impossible_windows_are_refused(window: Any) -> None:
    with pytest.raises(InvalidInputError, match="window"):
        checked_window(window, (0, 255))


def test_numbers_of_a_function_are_plain_json() -> None:
    function = TransferFunction(((np.float32(0.5), (1, 0, np.float64(0.25))),), ((0, 1),))
    assert json.loads(function.to_json())["colors"] == [[0.5, 1.0, 0.0, 0.25]]
