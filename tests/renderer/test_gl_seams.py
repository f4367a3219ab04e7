"""Where volumes are cut into bricks and slabs, and what is dropped, never shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.codec.errors import ResourceError
from octobrick.renderer import Camera, PictureTooLargeError, Renderer, TransferFunction

from .array_source import ArraySource

pytestmark = pytest.mark.gl

FUNCTION = TransferFunction(
    ((0.1, (0.9, 0.3, 0.1)), (0.5, (0.2, 0.7, 0.9)), (1.0, (1.0, 1.0, 0.9))),
    ((0.12, 0.0), (0.4, 0.08), (0.45, 0.0), (0.6, 0.0), (0.7, 0.4), (1.0, 0.9)),
)
SIZE = (72, 56)


def cameras(source: ArraySource) -> list[Camera]:
    return [
        Camera.orbit(source, 30, 20),
        Camera.orbit(source, 200, -40),
        Camera.orbit(source, 45, 0).orthographic(),
        Camera.orbit(source, 10, 85).orthographic(),
        Camera((40.0, 33.0, 28.0), (60.0, 40.0, 40.0), (0.0, 0.0, 1.0), 110.0),  # inside
    ]


@pytest.mark.parametrize("shading", [False, True])
@pytest.mark.parametrize("view", range(5))
def test_slabs_of_any_thickness_give_the_same_picture(
    renderer: Renderer, blobs: NDArray[np.uint8], view: int, shading: bool
) -> None:
    source = ArraySource(blobs, brick=16, nlevels=1)
    camera = cameras(source)[view]
    whole = renderer.render(source, camera, FUNCTION, SIZE, shading=shading)
    assert whole.stats.slabs_planned == 1
    most = 0
    for budget in ("512KiB", "256KiB", "128KiB"):  # of a buffer of 1 MiB
        with Renderer("4MiB", slab_budget=budget) as small:
            cut = small.render(source, camera, FUNCTION, SIZE, shading=shading)
        most = max(most, cut.stats.slabs_planned)
        assert cut.stats.slab_nbytes <= 512 << 10
        np.testing.assert_array_equal(cut.premultiplied, whole.premultiplied)
    assert most >= 4


@pytest.mark.parametrize("shading", [False, True])
def test_bricks_of_any_size_give_the_same_picture(
    renderer: Renderer, blobs: NDArray[np.uint8], shading: bool, require_alike: Callable[..., None]
) -> None:
    sources = [ArraySource(blobs, brick=brick, nlevels=1) for brick in (16, 32, 64, (17, 24, 20))]
    camera = Camera.orbit(sources[0], 30, 20)
    wanted, *others = (
        renderer.render(source, camera, FUNCTION, SIZE, shading=shading).rgba for source in sources
    )
    for found in others:
        require_alike(found, wanted)


@pytest.mark.parametrize("codec", [None, S3dc(), S3dc((4, 4, 4), 2)])
@pytest.mark.parametrize("view", range(5))
def test_dropping_bricks_and_skipping_space_changes_no_pixel(
    renderer: Renderer,
    unculled: Renderer,
    blobs: NDArray[np.uint8],
    view: int,
    codec: S3dc | None,
) -> None:
    source = ArraySource(blobs, codec=codec, brick=16, nlevels=1)
    camera = cameras(source)[view]
    for shading in (False, True):
        wanted = unculled.render(source, camera, FUNCTION, SIZE, shading=shading)
        found = renderer.render(source, camera, FUNCTION, SIZE, shading=shading)
        assert found.stats.bricks["transparent"] + found.stats.bricks["frustum"] > 0
        assert wanted.stats.bricks["sampled"] == wanted.stats.bricks["total"]
        np.testing.assert_array_equal(found.premultiplied, wanted.premultiplied)


@pytest.mark.parametrize("at", [60, 121, 200])
def test_a_spike_between_values_survives_dropping(
    renderer: Renderer, unculled: Renderer, blobs: NDArray[np.uint8], at: int
) -> None:
    """Interpolation crosses values that no voxel has."""
    source = ArraySource(blobs, brick=16, nlevels=1)
    spike = ((at + 0.2, 0.0), (at + 0.5, 0.9), (at + 0.8, 0.0))
    function = TransferFunction(((0.0, (1.0, 1.0, 1.0)),), spike, "value")
    camera = Camera.orbit(source, 120, 30)
    wanted = unculled.render(source, camera, function, SIZE, window=(0, 255))
    found = renderer.render(source, camera, function, SIZE, window=(0, 255))
    assert found.premultiplied.any()
    np.testing.assert_array_equal(found.premultiplied, wanted.premultiplied)


def test_a_pool_smaller_than_the_view_gives_the_same_picture(
    renderer: Renderer, blobs: NDArray[np.uint8]
) -> None:
    source = ArraySource(blobs, codec=S3dc(), brick=16, nlevels=1)
    camera = Camera.orbit(source, 30, 20)
    wanted = renderer.render(source, camera, FUNCTION, SIZE, level=0)
    nbytes = S3dc().encoded_nbytes((16, 16, 16), np.uint8)
    with Renderer(600_000 + 3 * nbytes, slab_budget=600_000) as tiny:
        for _ in range(2):
            found = tiny.render(source, camera, FUNCTION, SIZE, level=0)
            assert found.stats.resident_nbytes <= 3 * nbytes
            np.testing.assert_array_equal(found.premultiplied, wanted.premultiplied)


def test_a_second_picture_uploads_and_decodes_nothing(blobs: NDArray[np.uint8]) -> None:
    source = ArraySource(blobs, codec=S3dc(), brick=16, nlevels=1)
    with Renderer() as fresh:
        first = fresh.render(source, Camera.orbit(source, 30, 20), FUNCTION, SIZE)
        reads = source.reads
        second = fresh.render(source, Camera.orbit(source, 70, 20), FUNCTION, SIZE)
    assert first.stats.uploaded_nbytes > 0
    assert first.stats.decoded_nbytes > 0
    assert (second.stats.uploaded_nbytes, second.stats.decoded_nbytes) == (0, 0)
    assert source.reads == reads


def test_volumes_in_turn_do_not_mix(renderer: Renderer, blobs: NDArray[np.uint8]) -> None:
    """One pool and one slab serve every volume, type and codec."""
    sources: list[ArraySource] = [
        ArraySource(blobs, codec=S3dc(), brick=16, nlevels=1),
        ArraySource(blobs.astype(np.uint16) * 200, codec=None, brick=32, nlevels=1),
        ArraySource(255 - blobs, codec=S3dc(), brick=16, nlevels=1, window=(0, 255)),
        ArraySource(blobs.astype(np.float32) / 3, codec=S3dc(bits=8), brick=16, nlevels=1),
    ]
    camera = Camera.orbit(sources[0], 30, 20)

    def picture(source: ArraySource, renderer: Renderer) -> NDArray[Any]:
        return renderer.render(source, camera, FUNCTION, SIZE).premultiplied

    with Renderer("2200KiB", slab_budget="2MiB") as small:
        found = [picture(source, small) for source in sources * 2]
    for i, source in enumerate(sources):
        with Renderer() as fresh:
            wanted = picture(source, fresh)
        for other in (found[i], found[i + len(sources)]):
            np.testing.assert_array_equal(other, wanted)


def test_types_of_the_same_values_give_the_same_picture(
    renderer: Renderer, blobs: NDArray[np.uint8], require_alike: Callable[..., None]
) -> None:
    small = blobs // 2
    camera = Camera.orbit(ArraySource(small, brick=32, nlevels=1), 30, 20)
    pictures = [
        renderer.render(
            ArraySource(small.astype(dtype), brick=32, nlevels=1),
            camera, FUNCTION, SIZE, window=(0, 127), shading=False,
        ).rgba
        for dtype in ("uint8", "int8", "uint16", "int16", "float32")
    ]  # fmt: skip
    # GPUs weigh 8-bit texels with 8 bits, wider ones with more.
    tolerance = 1 if "llvmpipe" in renderer.gl_renderer else 4
    for found in pictures[1:]:
        require_alike(found, pictures[0], tolerance=tolerance)


def test_rays_that_are_opaque_end_the_frame_early() -> None:
    voxels = np.full((64, 16, 16), 200, np.uint8)
    source = ArraySource(voxels, brick=16, nlevels=1, fill_value=1)
    camera = Camera.orbit(source, 0, 90).orthographic()
    opaque = TransferFunction(((0.0, (1.0, 1.0, 1.0)),), ((0.0, 1.0),))
    with Renderer("1MiB", slab_budget="8KiB") as small:
        image = small.render(source, camera, opaque, (16, 16), shading=False)
    assert image.stats.slabs_planned == 3
    assert image.stats.slabs == 1


def test_a_view_that_fits_no_budget_is_refused_with_what_to_do(blobs: NDArray[np.uint8]) -> None:
    source = ArraySource(blobs, brick=16, nlevels=1)
    with (
        Renderer("1MiB", slab_budget="20KB") as small,
        pytest.raises(PictureTooLargeError, match="raise memory_budget") as caught,
    ):
        small.render(source, Camera.orbit(source, 30, 20), FUNCTION, SIZE)
    assert isinstance(caught.value, ResourceError)


def test_a_budget_too_small_for_the_finest_level_shows_a_coarser_one(
    blobs: NDArray[np.uint8],
) -> None:
    source = ArraySource(blobs, codec=S3dc(), brick=16)
    camera = Camera.orbit(source, 30, 20, fov_degrees=5)
    with Renderer("180KB", slab_budget="100KB") as small:
        image = small.render(source, camera, FUNCTION, (200, 200))
    assert image.fidelity.finest_level_wanted == 0
    assert image.fidelity.level == image.stats.level == 1
    assert not image.fidelity.converged
    assert 0 < image.fidelity.max_error <= 255
