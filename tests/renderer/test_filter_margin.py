"""The margin that deblocking reads is enough, and what it takes is known before."""

from __future__ import annotations

import numpy as np
import pytest

from octobrick.codec import S3dc, Zerobit, reference_deblock
from octobrick.codec.deblock import rational_bezier
from octobrick.renderer.bezier_curve import BezierCurve
from octobrick.renderer.filter_margin import filter_margin, filtered_box, scratch_nbytes
from octobrick.store.box import Box


@pytest.mark.parametrize(
    "codec", [S3dc((2, 4, 4)), S3dc((8, 2, 3)), S3dc((1, 5, 6)), Zerobit(), S3dc(max_error=1)]
)
def test_no_voxel_beyond_the_margin_counts(codec: S3dc | Zerobit) -> None:
    block = (4, 4, 4) if isinstance(codec, Zerobit) else codec.block
    margin = filter_margin(codec)
    rng = np.random.default_rng(0)
    for axis in range(3):
        shape = [block[a] * (7 if a == axis else 2) for a in range(3)]
        voxels = rng.normal(size=shape).astype(np.float32)
        whole = rational_bezier(voxels, block, 1, value_range=1000)
        for at in range(3 * block[axis], 4 * block[axis]):
            for other in range(shape[axis]):
                changed = voxels.copy()
                np.moveaxis(changed, axis, 0)[other] += 100 + rng.random()
                found = rational_bezier(changed, block, 1, value_range=1000)
                moved = np.abs(found.take(at, axis) - whole.take(at, axis)).max()
                if abs(at - other) > margin[axis]:
                    assert moved < 1e-6


def test_levels_that_are_stored_raw_have_no_margin_and_no_scratch() -> None:
    box = Box((3, 4, 5), (10, 10, 10))
    assert filter_margin(None) == (0, 0, 0)
    assert filtered_box(box, (20, 20, 20), None) == box
    assert scratch_nbytes(box, (20, 20, 20), np.dtype("uint8"), None) == 0


def test_the_margin_ends_at_the_faces_of_the_level() -> None:
    box = Box((0, 10, 30), (5, 20, 40))
    assert filtered_box(box, (50, 50, 41), S3dc()) == Box((0, 0, 18), (17, 32, 41))


@pytest.mark.parametrize(
    ("before", "after"), [(2, 1), (4, 4), (5, 3), (8, 8), (16, 16), (16, 2), (32, 2), (48, 48)]
)
def test_the_terms_of_a_curve_are_those_of_bernstein_polynomials(before: int, after: int) -> None:
    curve = BezierCurve(before, after)
    binomials, ratios = curve.direct_terms()
    logs, positions = curve.logarithmic_terms()
    i = np.arange(curve.count)
    for k in range(curve.noutputs):
        wanted = np.exp(reference_deblock.log_basis(curve.count, curve.first + k))
        direct = binomials * ratios[k, 0] ** i
        np.testing.assert_allclose(direct / direct.sum(), wanted, rtol=1e-9)
        log = logs + i * positions[k, 0] + (curve.count - 1 - i) * positions[k, 1]
        np.testing.assert_allclose(np.exp(log), wanted, rtol=1e-9)
        if curve.is_direct(16):
            assert direct.sum() * np.exp(-28) > np.finfo(np.float32).tiny
            assert direct.sum() * 65535 < np.finfo(np.float32).max
