"""What the codec must survive: each extreme with its tests, of which some are here.

A row is an extreme and, in brackets, the parts that it may upset: S is S3Dc, Z zerobit, G gradients
and their directions, D deblocking. Under it stands, for each part, a test that fails where the part
does not bear it.

Nothing varies: constant blocks, constant volumes (S Z G D)
    S test_s3dc_promises.test_a_constant_block_is_exact
    Z test_zerobit_promises.test_constant_volumes_are_exact_and_cost_a_byte_per_unit_block
    Z test_zerobit_costs.test_a_cell_without_details_takes_six_bytes
    G test_gradient_field.test_constant_and_single_voxels_have_no_gradient
    D test_deblock.test_constant_volumes_stay_what_they_are

One voxel, one row, one plane, less than a block (S Z G D)
    S test_s3dc_is_the_reference.test_shapes_that_no_block_divides
    S test_s3dc_promises.test_blocks_larger_than_any_volume_are_one_block
    Z test_extremes.test_zerobit_of_volumes_thinner_than_a_cell_keeps_them
    G test_gradient_field.test_constant_and_single_voxels_have_no_gradient
    G test_extremes.test_an_axis_of_one_voxel_has_no_derivative_and_disturbs_no_other
    D test_deblock.test_a_volume_of_one_block_has_no_border
    D test_extremes.test_blocks_of_which_a_part_is_missing_are_filtered_within_the_hull

Extents that neither blocks nor cells nor two divide (S Z G D)
    S test_s3dc_is_the_reference.test_shapes_that_no_block_divides
    S test_extremes.test_a_block_at_the_edge_has_the_range_of_the_voxels_that_exist
    Z test_zerobit_promises.test_edges_are_continued_so_that_a_cut_cell_keeps_its_values
    Z test_zerobit_is_the_reference.test_any_shape_and_ratio
    G test_extremes.test_odd_extents_reduce_to_half_of_them_and_keep_a_gradient_up_to_the_faces
    G test_gradient_field.test_native_field_is_the_references
    D test_extremes.test_blocks_of_which_a_part_is_missing_are_filtered_within_the_hull
    D test_deblock.test_native_filter_is_the_reference_on_integers

One bit per index (S D)
    S test_extremes.test_one_bit_has_the_ends_of_each_block_and_nothing_between
    D test_deblock.test_auto_clamps_codes_of_one_and_two_bits

Eight bits per index for samples of eight (S)
    S test_s3dc_promises.test_8_bits_keep_8_bit_samples_exactly
    S test_s3dc_arithmetic.test_every_distance_and_range_of_8_bit_samples

The whole range of an integer type; 32 bits are refused (S Z G D)
    S test_s3dc_promises.test_the_full_range_of_integers_does_not_wrap
    S test_extremes.test_integers_of_32_bits_are_refused_and_not_wrapped
    Z test_zerobit_promises.test_full_range_does_not_wrap
    G test_gradient_field.test_unsigned_differences_do_not_wrap
    D test_extremes.test_the_whole_range_of_integers_is_filtered_without_wrapping

The greatest float32 of both signs side by side (S Z G D)
    S test_s3dc_promises.test_ranges_wider_than_float32_can_hold
    Z test_zerobit_promises.test_floats_at_the_edges_stay_finite
    G test_gradient_field.test_the_greatest_floats_do_not_overflow_and_keep_their_direction
    D test_deblock.test_the_greatest_floats_and_the_least_are_filtered

Denormal samples (S Z G D)
    S test_s3dc_promises.test_denormal_samples_keep_their_order_and_bound
    Z test_zerobit_promises.test_floats_at_the_edges_stay_finite
    G test_extremes.test_a_slope_of_denormals_is_kept
    D test_extremes.test_denormals_are_filtered_to_the_nearest_of_them

NaN and ±Inf, refused by their place (S Z G D)
    S test_s3dc_refuses.test_the_first_voxel_that_is_not_finite_is_named
    S test_s3dc_promises.test_the_caller_may_say_what_replaces_voxels_that_are_not_finite
    Z test_zerobit_refuses.test_a_voxel_that_is_not_finite_is_named
    G test_gradient_field.test_a_voxel_that_is_not_finite_is_named
    G test_gradient_code.test_what_is_not_finite_is_refused_by_its_place
    D test_deblock.test_a_voxel_that_is_not_finite_is_named

A range of a few float32 steps on a large offset (S D)
    S test_extremes.test_the_bound_holds_for_a_tiny_range_on_a_large_offset
    D test_extremes.test_a_tiny_range_on_a_large_offset_is_filtered_within_the_hull

Any strength λ: 0, 1e-300, 1e2, 1e4, 1e300, negative (D)
    D test_deblock.test_no_strength_leaves_the_control_points_hull
    D test_deblock.test_native_filter_is_the_reference_at_any_strength
    D test_deblock.test_any_range_to_measure_gradients_by_gives_finite_values

No gradient anywhere, or a single one (G)
    G test_gradient_code.test_zero_has_its_own_code_and_decodes_to_zero
    G test_extremes.test_a_field_without_gradients_reduces_to_one
    G test_gradient_field.test_a_single_gradient_among_zeros_wins_entirely

Gradients from 5e-324 to 1e308 (G)
    G test_gradient_code.test_length_does_not_matter_from_denormal_to_huge
    G test_gradient_code.test_the_least_and_the_greatest_gradients_keep_their_direction
    G test_gradient_field.test_extreme_magnitudes_survive_reduction

Directions on the borders of regions, and −0 (G)
    G test_gradient_code.test_directions_on_region_borders_are_within_the_bound
    G test_gradient_code.test_the_sign_of_zero_does_not_matter
    G test_extremes.test_a_code_on_a_border_decodes_alike_from_either_side

No details, all details, no voxels but background, nothing but noise (Z)
    Z test_zerobit_promises.test_ratio_1_keeps_every_detail_and_ratio_0_none
    Z test_zerobit_costs.test_a_void_block_takes_one_byte
    Z test_zerobit_costs.test_streams_of_a_full_block_have_640_and_4032_bytes

Up to 256 colours, and more (Z)
    Z test_zerobit_promises.test_up_to_256_colours_in_constant_cells_are_exact
    Z test_extremes.test_more_than_256_values_share_codewords_that_are_near_them

Averages below the threshold (Z)
    Z test_zerobit_promises.test_averages_are_kept_however_low_the_ratio_unless_they_are_counted

Voxels that are not cubes (G)
    G test_gradient_field.test_a_ramp_has_its_slope_everywhere_in_world_units
    G test_gradient_field.test_inside_it_is_numpys_gradient
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit, deblock, gradients, metrics
from octobrick.codec import reference_deblock as reference
from octobrick.codec.errors import UnsupportedError

from .zerobit_volumes import KINDS

FLOAT_TINY = np.finfo(np.float32).smallest_subnormal
THIN = [(1, 1, 1), (1, 1, 9), (1, 7, 1), (6, 1, 1), (1, 5, 18), (3, 2, 1)]
UNEVEN = [(17, 13, 11), (20, 17, 32), (5, 486, 3)]


# ---- The table above -------------------------------------------------------------------------


def rows() -> dict[str, list[tuple[str, str, str]]]:
    """Each row's title, and the part, module and test of its lines."""
    table: dict[str, list[tuple[str, str, str]]] = {}
    for line in (__doc__ or "").splitlines():
        if re.fullmatch(r"\S.* \([SZGD ]+\)", line):
            table[line] = []
        elif line.startswith("    "):
            part, module, test = re.fullmatch(r"    ([SZGD]) (test_\w+)\.(test_\w+)", line).groups()
            table[list(table)[-1]].append((part, module, test))
    return table


def functions_in(module: str) -> set[str]:
    tree = ast.parse(Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_extreme_is_held_by_tests_that_exist() -> None:
    table = rows()
    assert len(table) == 18
    for title, lines in table.items():
        parts = re.findall(r"[SZGD]", title[title.rindex("(") :])
        assert sorted({part for part, _, _ in lines}) == sorted(parts), title
        missing = [
            f"{module}.{test}" for _, module, test in lines if test not in functions_in(module)
        ]
        assert not missing, title


def test_every_test_of_this_file_holds_an_extreme() -> None:
    named = {t for lines in rows().values() for _, module, t in lines if module == "test_extremes"}
    here = {t for t in functions_in("test_extremes") if t.startswith("test_")}
    assert here - named == {
        "test_every_extreme_is_held_by_tests_that_exist",
        "test_every_test_of_this_file_holds_an_extreme",
    }


# ---- S3Dc ------------------------------------------------------------------------------------


def round_trip(codec: Any, array: NDArray[Any]) -> NDArray[Any]:
    decoded: NDArray[Any] = codec.decode(codec.encode(array), array.shape, array.dtype)
    return decoded


@pytest.mark.parametrize("shape", [*UNEVEN, (9, 1, 9)])
@pytest.mark.parametrize("bits", [1, 3, 8])
def test_a_block_at_the_edge_has_the_range_of_the_voxels_that_exist(
    noise: Any, dtype: Any, shape: tuple[int, int, int], bits: int
) -> None:
    """Were it padded, by zeros for one, its ends would not be those of its voxels."""
    array = noise(shape, dtype)
    if dtype.kind == "u":
        array = array // 2 + array.dtype.type(90)  # away from 0
    decoded = round_trip(S3dc((8, 8, 8), bits), array)
    for start in np.ndindex(*(-(-n // 8) for n in shape)):
        block = tuple(slice(8 * s, 8 * s + 8) for s in start)
        assert decoded[block].min() == array[block].min()
        assert decoded[block].max() == array[block].max()


def test_one_bit_has_the_ends_of_each_block_and_nothing_between(noise: Any, dtype: Any) -> None:
    array = noise((8, 8, 16), dtype)
    codec = S3dc((8, 8, 8), 1)
    decoded = round_trip(codec, array)
    for block in (array[..., :8], decoded[..., :8]), (array[..., 8:], decoded[..., 8:]):
        before, after = block
        assert set(np.unique(after)) == {before.min(), before.max()}
        upper = before.astype(float) > (float(before.min()) + float(before.max())) / 2
        assert (after[upper] == before.max()).all()
    every = np.arange(256, dtype=np.uint8).reshape(1, 16, 16)
    codec = S3dc((1, 16, 16), 1)
    assert codec.error_bound(every) == 128
    assert metrics.max_error(every, round_trip(codec, every)) == 127


@pytest.mark.parametrize("dtype", ["uint32", "int32"])
def test_integers_of_32_bits_are_refused_and_not_wrapped(dtype: str) -> None:
    array = np.full((8, 8, 8), np.iinfo(dtype).max, dtype)
    for run in (
        S3dc().encode,
        Zerobit().encode,
        gradients.central_differences,
        lambda a: deblock.rational_bezier(a, (4, 4, 4)),
    ):
        with pytest.raises(UnsupportedError, match=dtype):
            run(array)


@pytest.mark.parametrize("bits", range(1, 9))
@pytest.mark.parametrize("steps", [1e-3, 8, 40])
def test_the_bound_holds_for_a_tiny_range_on_a_large_offset(bits: int, steps: float) -> None:
    """At 1e8 float32 has steps of 8: less than that is lost before the codec sees it."""
    rng = np.random.default_rng(bits)
    array = (1e8 + rng.normal(size=(9, 10, 11)) * steps).astype(np.float32)
    codec = S3dc((4, 4, 4), bits)
    decoded = round_trip(codec, array)
    assert metrics.max_error(array, decoded) <= codec.error_bound(array)
    assert (decoded.min(), decoded.max()) == (array.min(), array.max())
    if steps < 1:
        np.testing.assert_array_equal(decoded, np.float32(1e8))
    else:
        # Half a step of the index and half of float32's.
        assert codec.error_bound(array) <= float(np.ptp(array)) / (2 * (2**bits - 1)) + 8


# ---- Zerobit ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("dtype", "channels"), KINDS)
@pytest.mark.parametrize("shape", THIN)
def test_zerobit_of_volumes_thinner_than_a_cell_keeps_them(
    noise: Any, dtype: str, channels: int, shape: tuple[int, int, int]
) -> None:
    """So few cells have a codeword for each of their details: rounding is all that is lost."""
    array = noise((*shape, 3) if channels == 3 else shape, dtype)
    decoded = round_trip(Zerobit(1), array)
    assert decoded.dtype == array.dtype
    error = np.abs(decoded.astype(np.float64) - array.astype(np.float64))
    # Fifteen coefficients make a voxel, each half off at most; float32 rounds relative to ±100.
    assert error.max() <= (7.5 if array.dtype.kind in "ui" else 1e-3)
    for level in (1, 2):
        smaller = tuple(-(-n // 2**level) for n in shape)
        assert Zerobit().decode_level(Zerobit(1).encode(array), level).shape[:3] == smaller


def test_more_than_256_values_share_codewords_that_are_near_them() -> None:
    """1024 values in boxes of 4 are at most two steps from the mean of their box."""
    step = 60
    values = np.random.default_rng(1).permutation(1024).astype(np.uint16) * np.uint16(step)
    array = values.reshape(8, 8, 16).repeat(4, 0).repeat(4, 1).repeat(4, 2)
    decoded = round_trip(Zerobit(0.05), array)
    assert 250 <= len(np.unique(decoded)) <= 257  # codewords, and the background
    assert metrics.max_error(array, decoded) <= 2 * step


# ---- Gradients -------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_of_one_voxel_has_no_derivative_and_disturbs_no_other(
    noise: Any, dtype: Any, axis: int
) -> None:
    shape = [6, 7, 8]
    shape[axis] = 1
    volume = noise(tuple(shape), dtype)
    gradient = gradients.central_differences(volume)
    assert not gradient[..., 2 - axis].any()
    others = [i for i in range(3) if i != axis]
    for i, along in zip(others, np.gradient(volume.astype(np.float64), axis=others), strict=True):
        np.testing.assert_allclose(gradient[..., 2 - i], along, rtol=1e-6, atol=1e-6)
    one = np.full((1, 1, 1, 3), (1, 2, 3), np.float32)
    np.testing.assert_array_equal(gradients.reduce(one), one)


@pytest.mark.parametrize("shape", [*UNEVEN, (1, 3, 5)])
def test_odd_extents_reduce_to_half_of_them_and_keep_a_gradient_up_to_the_faces(
    shape: tuple[int, int, int],
) -> None:
    fine = np.full((*shape, 3), (3, -1, 2), np.float32)
    coarse = gradients.reduce(fine)
    assert coarse.shape == (*(-(-n // 2) for n in shape), 3)
    np.testing.assert_allclose(coarse, np.broadcast_to(fine[0, 0, 0], coarse.shape), rtol=1e-6)


def test_a_field_without_gradients_reduces_to_one() -> None:
    for zero in (0.0, -0.0):
        coarse = gradients.reduce(np.full((5, 4, 3, 3), zero, np.float32))
        assert coarse.shape == (3, 2, 2, 3)
        np.testing.assert_array_equal(coarse, 0)


def test_a_slope_of_denormals_is_kept() -> None:
    ramp = (np.arange(8, dtype=np.float32) * FLOAT_TINY).reshape(1, 1, 8)
    gradient = gradients.central_differences(ramp)
    np.testing.assert_array_equal(gradient[0, 0], np.outer(np.ones(8), [FLOAT_TINY, 0, 0]))
    decoded = gradients.decode_directions(gradients.encode_directions(gradient))
    assert metrics.angular_error(gradient, decoded).max() < 0.1731


def test_a_code_on_a_border_decodes_alike_from_either_side() -> None:
    """Two equal components can be sorted in two ways, three in six: all must mean the same."""
    odd = np.arange(1, 256, 2)
    a, b = (g.ravel() for g in np.meshgrid(odd, odd))
    for first, second, other in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
        for sign in (1, -1):
            magnitudes = np.empty((len(a), 3), int)
            magnitudes[:, first], magnitudes[:, second] = a, sign * a
            magnitudes[:, other] = b
            decoded = gradients.decode_directions(((magnitudes + 255) // 2).astype(np.uint8))
            np.testing.assert_array_equal(decoded[:, first], sign * decoded[:, second])


# ---- Deblocking ------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [*UNEVEN, (1, 9, 20), (2, 1, 9), (1, 1, 9)])
@pytest.mark.parametrize("axes", ["average", "sequential"])
def test_blocks_of_which_a_part_is_missing_are_filtered_within_the_hull(
    noise: Any, shape: tuple[int, int, int], axes: Any
) -> None:
    volume = noise(shape, "float32")
    filtered = deblock.rational_bezier(volume, (8, 8, 8), axes=axes)
    assert filtered.shape == shape
    assert volume.min() <= filtered.min()
    assert filtered.max() <= volume.max()
    expected = reference.rational_bezier(volume, (8, 8, 8), 4, axes=axes)
    np.testing.assert_allclose(filtered, expected, atol=1e-5 * float(np.ptp(volume)))
    assert (filtered != volume).any()


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16"])
def test_the_whole_range_of_integers_is_filtered_without_wrapping(dtype: str) -> None:
    info = np.iinfo(dtype)
    step = np.full((1, 1, 16), info.min, dtype)
    step[..., 8:] = info.max
    filtered = deblock.rational_bezier(step, (1, 1, 8))[0, 0]
    assert (filtered[0], filtered[-1]) == (info.min, info.max)
    assert (np.diff(filtered) >= 0).all()


@pytest.mark.parametrize("strength", [0, 4, 1e300])
def test_denormals_are_filtered_to_the_nearest_of_them(strength: float) -> None:
    """As the same volume 2^120 times as large is, where nothing is denormal."""
    rng = np.random.default_rng(3)
    volume = (rng.integers(0, 8, (8, 9, 10)) * np.float64(FLOAT_TINY)).astype(np.float32)
    filtered = deblock.rational_bezier(volume, (4, 4, 4), strength)
    large = np.ldexp(volume.astype(np.float64), 120).astype(np.float32)
    expected = deblock.rational_bezier(large, (4, 4, 4), strength).astype(np.float64)
    off = np.abs(filtered - np.ldexp(expected, -120))
    assert off.max() <= 0.501 * float(FLOAT_TINY)
    assert len(np.unique(filtered)) == 8
    assert (filtered != volume).any()


@pytest.mark.parametrize("steps", [8, 40])
def test_a_tiny_range_on_a_large_offset_is_filtered_within_the_hull(steps: float) -> None:
    rng = np.random.default_rng(4)
    volume = (1e8 + rng.normal(size=(9, 10, 11)) * steps).astype(np.float32)
    filtered = deblock.rational_bezier(volume, (4, 4, 4))
    expected = reference.rational_bezier(volume, (4, 4, 4), 4)
    assert volume.min() <= filtered.min()
    assert filtered.max() <= volume.max()
    assert np.abs(filtered.astype(np.float64) - expected).max() <= 8  # a step of float32
