"""What S3Dc promises with a width per block, fitted end points, trained scales and predictions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import S3dc, _native, metrics, reduce, reference, reference_variable

from .generated import DTYPES, blocks, predictions, volumes

FLOAT_MAX = float(np.finfo(np.float32).max)


def squared_error(a: NDArray[Any], b: NDArray[Any]) -> float:
    return float(metrics.compare(a, b).sum_squared)


def round_trip(codec: S3dc, a: NDArray[Any], p: NDArray[Any] | None = None) -> NDArray[Any]:
    return codec.decode(codec.encode(a, prediction=p), a.shape, a.dtype, prediction=p)


def budgets(array: NDArray[Any]) -> st.SearchStrategy[float]:
    """From hardly more than tables to more than the voxels themselves."""
    return st.floats(1, 40) if array.dtype.itemsize > 1 else st.floats(1, 12)


# ---- One answer from all implementations -----------------------------------------------------


@given(st.data(), volumes(), blocks)
@settings(max_examples=80, deadline=None)
def test_a_bounded_code_is_the_references_and_keeps_its_bound(
    data: st.DataObject, array: NDArray[Any], block: tuple[int, int, int]
) -> None:
    prediction = data.draw(predictions(array))
    reach = float(array.max()) - float(array.min())
    bound = data.draw(st.sampled_from([0.0, 0.5, 1.0, reach / 100, reach / 3, 2 * reach]))
    codec = S3dc(block, max_error=bound)
    code = codec.encode(array, prediction=prediction)
    assert code == reference_variable.encode_bound(array, block, bound, prediction)
    decoded = codec.decode(code, array.shape, array.dtype, prediction=prediction)
    expected = reference_variable.decode(code, array.shape, array.dtype, block, prediction)
    np.testing.assert_array_equal(decoded, expected)
    assert metrics.max_error(array, decoded) <= bound


@given(st.data(), volumes(), blocks)
@settings(max_examples=60, deadline=None)
def test_a_budget_is_kept_and_decodes_as_the_reference(
    data: st.DataObject, array: NDArray[Any], block: tuple[int, int, int]
) -> None:
    prediction = data.draw(predictions(array))
    bits = data.draw(budgets(array))
    least = len(S3dc(block, slope=1e300).encode(array, prediction=prediction)) * 8 / array.size
    codec = S3dc(block, bits_per_voxel=max(bits, least), fitted=data.draw(st.booleans()))
    code = codec.encode(array, prediction=prediction)
    assert len(code) * 8 <= codec.bits_per_voxel * array.size * (1 + 1e-12)  # type: ignore[operator]
    decoded = codec.decode(code, array.shape, array.dtype, prediction=prediction)
    expected = reference_variable.decode(code, array.shape, array.dtype, block, prediction)
    np.testing.assert_array_equal(decoded, expected)
    assert decoded.min() >= array.min() or prediction is not None
    assert decoded.max() <= array.max() or prediction is not None


@given(st.data(), volumes(), blocks, st.integers(1, 8))
@settings(max_examples=60, deadline=None)
def test_a_predicted_code_of_one_width_is_the_references(
    data: st.DataObject, array: NDArray[Any], block: tuple[int, int, int], bits: int
) -> None:
    prediction = data.draw(predictions(array).filter(lambda p: p is not None))
    code = S3dc(block, bits).encode(array, prediction=prediction)
    assert code == reference_variable.encode_same(array, block, bits, prediction)
    decoded = S3dc(block, bits).decode(code, array.shape, array.dtype, prediction=prediction)
    expected = reference_variable.decode(code, array.shape, array.dtype, block, prediction)
    np.testing.assert_array_equal(decoded, expected)


@given(volumes(), blocks, st.integers(1, 8))
@settings(max_examples=60, deadline=None)
def test_a_scaled_code_decodes_as_the_reference_and_keeps_least_and_greatest(
    array: NDArray[Any], block: tuple[int, int, int], bits: int
) -> None:
    codec = S3dc(block, bits, scale="trained")
    code = codec.encode(array)
    assert len(code) == codec.encoded_nbytes(array.shape, array.dtype)
    decoded = codec.decode(code, array.shape, array.dtype)
    expected = reference_variable.decode_scaled(code, array.shape, array.dtype, block, bits)
    np.testing.assert_array_equal(decoded, expected)
    for _, voxels in reference.blocks(array.shape, block):
        assert decoded[voxels].min() == array[voxels].min()
        assert decoded[voxels].max() == array[voxels].max()


@given(volumes(), blocks, st.integers(1, 8))
@settings(max_examples=60, deadline=None)
def test_a_fixed_code_of_any_shape_is_the_references(
    array: NDArray[Any], block: tuple[int, int, int], bits: int
) -> None:
    code = S3dc(block, bits).encode(array)
    assert code == reference.encode(array, block, bits)
    decoded = S3dc(block, bits).decode(code, array.shape, array.dtype)
    np.testing.assert_array_equal(
        decoded, reference.decode(code, array.shape, array.dtype, block, bits)
    )


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(
    "codec",
    [S3dc(max_error=3), S3dc((4, 4, 4), bits_per_voxel=7), S3dc((4, 3, 5), slope=9),
     S3dc(bits=3, fitted=True), S3dc(bits=3, scale="trained")],
    ids=str,
)  # fmt: skip
def test_threads_instruction_sets_and_strides_change_nothing(
    noise: Any, dtype: str, codec: S3dc
) -> None:
    array = noise((21, 18, 83), dtype)
    array[:, :9] = array[0, 0, 0]
    code = codec.encode(array, threads=1)
    decoded = codec.decode(code, array.shape, dtype, threads=1)
    assert codec.encode(array, threads=5) == code
    assert codec.encode(np.asfortranarray(array), threads=2) == code
    assert codec.encode(array[::-1, :, ::-1][::-1, :, ::-1]) == code
    np.testing.assert_array_equal(codec.decode(code, array.shape, dtype, threads=5), decoded)
    if codec.variable:
        rules = {"max_error": "BOUND", "bits_per_voxel": "BUDGET", "slope": "SLOPE"}
        name = next(n for n in rules if getattr(codec, n) is not None)
        rule = _native.WidthRule[rules[name]]
        scalar = _native.variable_encode(
            array, codec.block, rule, getattr(codec, name), bool(codec.fitted), None, 1, False
        )
        out = np.empty((18, 83, 21), dtype).transpose(2, 0, 1)
        _native.variable_decode_into(code, out, codec.block, None, 3, False)
    else:
        scaled = codec.scale == "trained"
        scalar = _native.encode(array, codec.block, 3, 1, False, bool(codec.fitted), scaled)
        out = np.empty((18, 83, 21), dtype).transpose(2, 0, 1)
        _native.decode_into(code, out, codec.block, 3, 3, False, scaled)
    assert scalar == code
    np.testing.assert_array_equal(out, decoded)


# ---- Size and error --------------------------------------------------------------------------


def two_halves(dtype: str = "uint8") -> NDArray[Any]:
    """Nothing on one side, noise on the other."""
    array = np.full((32, 32, 32), 9, dtype)
    array[:, :, 16:] = np.random.default_rng(3).integers(0, 200, (32, 32, 16))
    return array


def test_bits_go_where_they_help() -> None:
    array = two_halves()
    codec = S3dc(bits_per_voxel=2)
    widths = codec.block_widths(codec.encode(array), array.shape, array.dtype)
    assert (widths[:, :, :2] == 0).all()
    assert set(np.unique(widths[:, :, 2:])) <= {3, 4}
    fixed = round_trip(S3dc(bits=2), array)
    assert squared_error(array, round_trip(codec, array)) < squared_error(array, fixed) / 3


def test_no_other_widths_have_less_error_with_as_few_bits() -> None:
    """Every combination of widths of four blocks is tried."""
    rng = np.random.default_rng(5)
    array = (rng.normal(size=(4, 4, 16)) * np.repeat([1, 4, 20, 50], 4) + 100).astype(np.uint8)
    codec = S3dc((4, 4, 4), bits_per_voxel=3, fitted=False)
    widths = codec.block_widths(codec.encode(array), array.shape, array.dtype).ravel()
    errors = np.empty((4, 9))
    for k, (_, voxels) in enumerate(reference.blocks(array.shape, (4, 4, 4))):
        for w in range(9):
            block = array[voxels]
            level = np.uint8(np.floor(block.mean() + 0.5))
            ends = (level, level) if w == 0 else (block.min(), block.max())
            indices = reference_variable.quantise(block, *ends, w)
            decoded = reference_variable.dequantise(indices, *ends, w)
            errors[k, w] = squared_error(block, decoded)
    found = sum(errors[k, w] for k, w in enumerate(widths))
    combinations = np.stack(np.meshgrid(*[range(9)] * 4), -1).reshape(-1, 4)
    allowed = combinations[combinations.sum(1) <= widths.sum()]
    assert found == pytest.approx(min(errors[range(4), w].sum() for w in allowed))


def test_blocks_that_are_all_alike_share_a_budget_to_its_last_unit() -> None:
    """All steps have one slope: none of them was taken once."""
    tile = np.random.default_rng(1).integers(0, 250, (8, 8, 8))
    array = np.tile(tile, (4, 4, 4)).astype(np.uint8)
    code = S3dc(bits_per_voxel=2.5).encode(array)
    assert 2.45 < len(code) * 8 / array.size <= 2.5


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("block", [(4, 4, 4), (8, 8, 8)])
def test_fitting_lowers_the_squared_error_and_keeps_the_size(
    noise: Any, dtype: str, block: tuple[int, int, int]
) -> None:
    array = noise((16, 16, 48), dtype)
    for bits in (1, 2, 3, 4):
        plain, fitted = S3dc(block, bits), S3dc(block, bits, fitted=True)
        assert len(fitted.encode(array)) == len(plain.encode(array))
        gain = squared_error(array, round_trip(plain, array)) / squared_error(
            array, round_trip(fitted, array)
        )
        assert gain > {1: 2, 2: 1.3, 3: 1.1, 4: 1.03}[bits]


@pytest.mark.parametrize("dtype", DTYPES)
def test_trained_scales_lower_the_squared_error_of_skewed_data(dtype: str) -> None:
    rng = np.random.default_rng(2)
    array = (rng.exponential(1, (24, 24, 24)) * 12).clip(0, 120).astype(dtype)
    for bits in (2, 4):
        plain, scaled = S3dc(bits=bits), S3dc(bits=bits, scale="trained")
        error = squared_error(array, round_trip(scaled, array))
        assert error < squared_error(array, round_trip(plain, array)) / 1.4


def test_enough_bits_are_lossless(noise: Any) -> None:
    for dtype in DTYPES:
        array = noise((9, 10, 11), dtype)
        for codec in (S3dc(bits_per_voxel=150), S3dc(max_error=0), S3dc((4, 4, 4), slope=1e-30)):
            np.testing.assert_array_equal(round_trip(codec, array), array)


def test_the_last_level_is_the_greatest_voxel_where_the_range_of_a_block_is_rounded() -> None:
    """A raw block of −1.7e38 and 2e-6 once had 0 as its last level, so no decoder took it."""
    array = np.array([-1.7280485e38, 2.1e-6, -1, 0], np.float32).reshape(1, 1, 4)
    for codec in (S3dc(max_error=0), S3dc(bits=2, scale="trained")):
        assert round_trip(codec, array).max() == array.max()


def test_the_bound_of_a_variable_code_is_what_decoders_find(noise: Any) -> None:
    array = noise((12, 13, 14), "int16")
    for codec in (S3dc(max_error=50), S3dc(bits_per_voxel=3), S3dc(bits=2, fitted=True),
                  S3dc(bits=2, scale="trained")):  # fmt: skip
        found = metrics.max_error(array, round_trip(codec, array))
        assert codec.error_bound(array) == found


def test_one_slope_balances_many_bricks() -> None:
    bricks = [two_halves()[:16, :16, x : x + 8] for x in range(0, 32, 8)]
    codec = S3dc.balanced(bricks, 2.0)
    sizes = [len(codec.encode(brick)) * 8 / brick.size for brick in bricks]
    assert sizes[0] < 0.2 < 3 < sizes[3]
    assert 1.8 < np.mean(sizes) <= 2.0
    alone = S3dc(bits_per_voxel=2.0)
    together = sum(squared_error(b, round_trip(codec, b)) for b in bricks)
    assert together < sum(squared_error(b, round_trip(alone, b)) for b in bricks) / 2


def test_the_true_range_of_fitted_blocks_is_told(noise: Any) -> None:
    array = noise((9, 8, 17), "int16")
    ranges = S3dc((4, 4, 4), 2, fitted=True).block_ranges(array)
    for cell, voxels in reference.blocks(array.shape, (4, 4, 4)):
        assert tuple(ranges[cell]) == (array[voxels].min(), array[voxels].max())


# ---- Predictions -----------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
def test_a_coarser_level_predicts_a_smooth_volume_well(dtype: str) -> None:
    z, y, x = np.indices((32, 32, 32))
    array = ((np.sin(z / 6) + np.cos(y / 7) * np.sin(x / 5)) * 50 + 110).astype(dtype)
    coarse = reduce.mean2(array)
    prediction = reduce.upsample2(coarse, array.shape)
    plain = round_trip(S3dc(bits=3), array)
    predicted = round_trip(S3dc(bits=3), array, prediction)
    assert squared_error(array, predicted) < squared_error(array, plain) / 10


def test_a_prediction_that_is_right_costs_tables_only(noise: Any) -> None:
    for dtype in DTYPES:
        array = noise((16, 16, 16), dtype)
        codec = S3dc(max_error=0)
        code = codec.encode(array, prediction=array)
        assert len(code) == 2 * 8 * array.itemsize + 8 + 4
        decoded = codec.decode(code, array.shape, dtype, prediction=array)
        np.testing.assert_array_equal(decoded, array)


def test_a_prediction_at_the_other_end_of_float32_does_no_harm() -> None:
    array = np.full((4, 4, 4), FLOAT_MAX, np.float32)
    array[0, 0, 0] = -FLOAT_MAX
    for codec in (S3dc(bits=1), S3dc(max_error=0), S3dc(bits_per_voxel=20)):
        np.testing.assert_array_equal(round_trip(codec, array, -array), array)


def test_a_foreign_prediction_is_refused_with_both_named(noise: Any) -> None:
    array = noise((4, 4, 4), "uint8")
    for other in (noise((4, 4, 5), "uint8"), noise((4, 4, 4), "int8")):
        with pytest.raises(ValueError, match=r"the prediction is .* but the array"):
            S3dc().encode(array, prediction=other)


# ---- The level above -------------------------------------------------------------------------


@given(volumes())
@settings(max_examples=60, deadline=None)
def test_upsampling_is_the_references_and_stays_within_the_volume(array: NDArray[Any]) -> None:
    coarse = reduce.mean2(array)
    fine = reduce.upsample2(coarse, array.shape)
    np.testing.assert_array_equal(fine, reference.upsample2(coarse, array.shape))
    assert fine.min() >= coarse.min()
    assert fine.max() <= coarse.max()


def test_upsampling_a_ramp_gives_the_ramp_but_for_its_ends() -> None:
    ramp = np.broadcast_to(np.arange(64, dtype=np.float32), (6, 6, 64))
    fine = reduce.upsample2(reduce.mean2(ramp), ramp.shape)
    np.testing.assert_array_equal(fine[:, :, 1:-1], ramp[:, :, 1:-1])


def test_upsampling_refuses_a_shape_that_is_not_twice() -> None:
    with pytest.raises(ValueError, match=r"\(2, 2, 2\) voxels is not half of \(4, 4, 5\)"):
        reduce.upsample2(np.zeros((2, 2, 2), np.uint8), (4, 4, 5))
