"""Pictures while bricks arrive, prefetching, and time steps in order."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.renderer import Camera, Renderer, TransferFunction, frames, play
from octobrick.renderer.streaming import continued
from octobrick.store import ingest, open_volume

from .array_source import ArraySource, SlowFirstLevel, Times

pytestmark = pytest.mark.gl

FUNCTION = TransferFunction(
    ((0.2, (0.9, 0.3, 0.1)), (1.0, (1.0, 1.0, 0.9))), ((0.15, 0.0), (0.7, 0.2), (1.0, 0.4))
)
SIZE = (60, 50)
VISCOUS = Path(__file__).parents[3] / "shared" / "data" / "tv_viscous_run01"


@pytest.fixture(params=["cpu", "gpu"])
def streaming(request: pytest.FixtureRequest) -> Iterator[Renderer]:
    with Renderer("64MiB", decode=request.param) as renderer:
        yield renderer


def test_the_first_picture_comes_before_the_bricks_and_the_last_is_the_whole(
    streaming: Renderer, renderer: Renderer, blobs: NDArray[np.uint8]
) -> None:
    source = SlowFirstLevel(blobs, codec=S3dc(), brick=16)
    camera = Camera.orbit(source, 30, 20)
    pictures = frames(streaming, source, camera, FUNCTION, SIZE, level=0)
    first = next(pictures)
    assert first.stats.bricks["substituted"] > 0
    assert not first.fidelity.converged
    assert first.fidelity.coarsest_level == len(source.levels) - 1
    wanted = renderer.render(
        ArraySource(blobs, codec=S3dc(), brick=16), camera, FUNCTION, SIZE, level=0
    )
    # Coarse, but the same thing in the same place.
    assert np.abs(first.premultiplied - wanted.premultiplied).mean() < 0.05
    assert np.abs(first.premultiplied - wanted.premultiplied).max() > 0.05
    source.release.set()
    *_, last = pictures
    assert last.fidelity.converged
    assert last.fidelity.coarsest_level is None
    np.testing.assert_array_equal(last.premultiplied, wanted.premultiplied)


def test_a_view_that_changes_cancels_what_the_one_before_wanted(
    streaming: Renderer, blobs: NDArray[np.uint8]
) -> None:
    source = SlowFirstLevel(blobs, codec=S3dc(), brick=16)
    for azimuth in (0, 90):
        camera = Camera.orbit(source, azimuth, 20).zoomed(4)
        streaming.render(source, camera, FUNCTION, SIZE, level=0, wait=False)
    assert streaming.load_stats.cancelled > 0
    source.release.set()


def test_bricks_on_the_camera_s_way_are_read_before_it_gets_there(
    streaming: Renderer, blobs: NDArray[np.uint8]
) -> None:
    source = ArraySource(blobs, codec=S3dc(), brick=16)
    cameras = [
        Camera.look_at((x, -90.0, 30.0), (x, 0.0, 30.0), fov_degrees=10.0)
        for x in (5.0, 25.0, 45.0)
    ]
    for camera in cameras[:2]:
        *_, last = frames(streaming, source, camera, FUNCTION, SIZE, level=0)
        assert last.fidelity.converged
        read_nbytes = streaming.load_stats.read_nbytes
        streaming.render(source, camera, FUNCTION, SIZE, level=0, wait=False)
    deadline = time.monotonic() + 1
    while streaming.load_stats.read_nbytes == read_nbytes and time.monotonic() < deadline:
        time.sleep(0.01)
    before = streaming.load_stats.prefetch_hits
    streaming.render(source, cameras[2], FUNCTION, SIZE, level=0)
    assert streaming.load_stats.prefetch_hits > before


def test_a_camera_that_moves_goes_on_as_it_did() -> None:
    one = Camera.look_at((0.0, -9.0, 0.0), (0.0, 0.0, 0.0))
    two = Camera.look_at((1.0, -8.0, 0.0), (0.0, 0.0, 0.0))
    ahead = continued(one, two)
    assert ahead is not None
    assert ahead.eye_world_xyz == (2.0, -7.0, 0.0)
    assert continued(one, one) is None
    assert continued(one, two.orthographic()) is None
    assert continued(one, Camera.look_at((0.0, -4.5, 0.0), (0.0, 0.0, 0.0))) is None


def test_time_steps_play_in_order_none_skipped_none_torn(
    streaming: Renderer, renderer: Renderer, blobs: NDArray[np.uint8]
) -> None:
    steps = [np.roll(blobs, 7 * i, axis=2) for i in range(4)]
    source = Times([ArraySource(step, codec=S3dc(), brick=16) for step in steps])
    camera = Camera.orbit(source, 30, 20)  # type: ignore[arg-type]
    played = list(play(streaming, source, camera, FUNCTION, SIZE, level=0))
    assert len(played) == 4
    for image, step in zip(played, steps, strict=True):
        alone = ArraySource(step, codec=S3dc(), brick=16)
        window, found = source.window, image.premultiplied
        wanted = renderer.render(alone, camera, FUNCTION, SIZE, level=0, window=window)
        np.testing.assert_array_equal(found, wanted.premultiplied)
    assert streaming.load_stats.prefetch_hits > 0
    again = list(play(streaming, source, camera, FUNCTION, SIZE, times=[2, 0], level=0))
    np.testing.assert_array_equal(again[0].premultiplied, played[2].premultiplied)
    np.testing.assert_array_equal(again[1].premultiplied, played[0].premultiplied)


@pytest.mark.skipif(not VISCOUS.exists(), reason="the time series is not at hand")
def test_a_real_time_series_plays_whole_steps_in_bounded_memory(tmp_path: Path) -> None:
    budget = 600_000  # three of the four steps
    ingest(f"{VISCOUS}/t0[1-4]0.raw.gz", tmp_path / "v.zarr", codec=S3dc())
    function = TransferFunction(((0.0, (1.0, 0.8, 0.4)),), ((0.2, 0.0), (0.6, 0.3)))
    with open_volume(tmp_path / "v.zarr") as volume, Renderer(budget * 2) as renderer:
        camera = Camera.orbit(volume, 30, 20)
        played = list(play(renderer, volume, camera, function, SIZE, level=0))
        assert volume.nt == len(played) == 4
        assert renderer.load_stats.prefetch_hits > 0
        for t, image in enumerate(played):
            alone = renderer.render(volume, camera, function, SIZE, level=0, t=t)
            np.testing.assert_array_equal(image.premultiplied, alone.premultiplied)
            assert image.stats.resident_nbytes <= budget * 2
        assert len({image.premultiplied.tobytes() for image in played}) == 4
