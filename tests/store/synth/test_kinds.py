"""Procedural volumes: known formulas, known sizes, and pieces that equal the whole."""

from __future__ import annotations

import math

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError
from octobrick.store.synth import KINDS, SYNTH_DTYPES, planes
from octobrick.store.synth.blocks import Blocks
from octobrick.store.synth.chance import at_lattice
from octobrick.store.synth.spheres import Spheres

SHAPE = (37, 29, 41)
# Written down, so that volumes made years apart are the same.
CHANCE_AT_1_2_3_4 = 0.26539790630340576


@pytest.mark.parametrize("dtype", SYNTH_DTYPES)
@pytest.mark.parametrize("kind", KINDS)
def test_a_piece_equals_the_same_piece_of_the_whole(kind: str, dtype: str) -> None:
    whole = planes(kind, SHAPE, dtype, 0, 37, seed=5)
    assert (whole.shape, whole.dtype) == (SHAPE, np.dtype(dtype))
    for z0, z1 in ((0, 1), (11, 20), (36, 37)):
        np.testing.assert_array_equal(planes(kind, SHAPE, dtype, z0, z1, seed=5), whole[z0:z1])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 9), (3, 1, 1), (2, 65, 3), (17, 2, 2)])
def test_every_shape_can_be_made(kind: str, shape: tuple[int, int, int]) -> None:
    voxels = planes(kind, shape, "float32", 0, shape[0])
    assert voxels.shape == shape
    assert 0 <= voxels.min() <= voxels.max() <= 1


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "marschner-lobb"])
def test_seeds_choose(kind: str) -> None:
    first = planes(kind, SHAPE, "uint16", 0, 37, seed=1)
    np.testing.assert_array_equal(planes(kind, SHAPE, "uint16", 0, 37, seed=1), first)
    for seed in (0, 2, 2**32 + 1):
        assert (planes(kind, SHAPE, "uint16", 0, 37, seed=seed) != first).mean() > 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_integers_are_the_floats_spread_over_their_range(kind: str) -> None:
    values = planes(kind, SHAPE, "float32", 0, 37).astype(float)
    for dtype in ("uint8", "uint16", "int16"):
        limits = np.iinfo(dtype)
        exact = limits.min + values * (limits.max - limits.min)
        samples = planes(kind, SHAPE, dtype, 0, 37)
        assert np.abs(samples - exact).max() < 0.51


def test_marschner_lobb_is_the_formula_of_the_paper() -> None:
    n, alpha, frequency = 41, 0.25, 6.0
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, n)] * 3, indexing="ij")
    rings = np.cos(2 * math.pi * frequency * np.cos(math.pi * np.hypot(x, y) / 2))
    expected = (1 - np.sin(math.pi * z / 2) + alpha * (1 + rings)) / (2 * (1 + alpha))
    np.testing.assert_allclose(
        planes("marschner-lobb", (n, n, n), "float32", 0, n), expected, atol=3e-7
    )


def test_spheres_have_the_volume_of_spheres_and_do_not_touch() -> None:
    shape = (128, 128, 128)
    field = Spheres(shape, seed=3)
    spheres = list(field.spheres())
    assert len(spheres) == 8**3
    expected = sum(s.value * 4 / 3 * math.pi * s.radius**3 for s in spheres)
    found = planes("spheres", shape, "float32", 0, 128, seed=3).sum(dtype=float)
    assert found == pytest.approx(expected, rel=0.02)
    for sphere in spheres[:20]:
        z, y, x = (math.floor(c) for c in sphere.center_zyx)
        assert field.plane(z)[y, x] == pytest.approx(sphere.value)
    centers = np.array([s.center_zyx for s in spheres])
    radii = np.array([s.radius for s in spheres])
    gaps = np.linalg.norm(centers[:, None] - centers, axis=2) - radii[:, None] - radii
    assert gaps[~np.eye(len(spheres), dtype=bool)].min() >= 0.9


def test_blocks_are_constant_and_some_are_empty() -> None:
    shape = (160, 160, 160)
    edge = Blocks(shape, 0).edge
    assert edge == 10
    voxels = planes("blocks", shape, "uint16", 0, 160).reshape(16, 10, 16, 10, 16, 10)
    assert np.ptp(voxels, axis=(1, 3, 5)).max() == 0
    empty = (voxels[:, 0, :, 0, :, 0] == 0).mean()
    assert empty == pytest.approx(0.25, abs=0.03)


def test_fractal_noise_is_centred_and_neighbours_are_alike() -> None:
    noise = planes("fractal-noise", (96, 96, 96), "float32", 0, 96, seed=8)
    assert 0.1 < noise.std() < 0.3
    for axis in range(3):
        step = np.abs(np.diff(noise, axis=axis))
        assert 0 < step.mean() < 0.06
        assert step.max() < 0.35
    means = [planes("fractal-noise", (8, 64, 64), "float32", 0, 8, seed=s).mean() for s in range(9)]
    assert np.mean(means) == pytest.approx(0.5, abs=0.06)


def test_chance_is_uniform_and_the_same_everywhere() -> None:
    places = np.arange(-200, 200)
    values = at_lattice(1, 2, -3, places, places)
    assert values.mean() == pytest.approx(0.5, abs=0.005)
    assert values.std() == pytest.approx(12**-0.5, abs=0.005)
    for axis in (0, 1):
        follower = np.roll(values, 1, axis)
        assert abs(np.corrcoef(values.ravel(), follower.ravel())[0, 1]) < 0.01
    assert at_lattice(7, 1, 2, np.array([3]), np.array([4])).item() == CHANCE_AT_1_2_3_4


@pytest.mark.parametrize("kind", ["marble", "wood"])
def test_textures_have_colours(kind: str) -> None:
    colours = planes(kind, SHAPE, "uint8", 3, 9, seed=2, rgb=True)
    assert colours.shape == (6, 29, 41, 3)
    np.testing.assert_array_equal(
        colours[2:3], planes(kind, SHAPE, "uint8", 5, 6, seed=2, rgb=True)
    )
    assert np.ptp(colours[..., 0]) > 60
    assert (colours[..., 0] != colours[..., 2]).any()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"kind": "cubes"}, "marble"),
        ({"shape": (4, 4)}, "z, y, x"),
        ({"shape": (4, 0, 4)}, "at least 1"),
        ({"dtype": "float64"}, "float32"),
        ({"dtype": "colour"}, "float32"),
        ({"z0": 3, "z1": 3}, "z0 < z1"),
        ({"z1": 5}, "z0 < z1"),
        ({"seed": -1}, "seed -1"),
        ({"rgb": True}, "marble or wood"),
    ],
)
def test_wrong_arguments_are_told(arguments: dict[str, object], word: str) -> None:
    given = {"kind": "blocks", "shape": (4, 4, 4), "dtype": "uint8", "z0": 0, "z1": 4}
    with pytest.raises(InvalidInputError, match=word):
        planes(**{**given, **arguments})  # type: ignore[arg-type]
