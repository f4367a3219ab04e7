"""From a real CT file to a picture: what compression costs, and that no seam shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc, metrics
from octobrick.renderer import Camera, Renderer, TransferFunction
from octobrick.store import Volume, ingest, open_volume

HEAD = Path(__file__).parents[2] / "data" / "ct_vhf_head.mhd"

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def head(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Volume]:
    folder = tmp_path_factory.mktemp("head")
    variants = {
        "s3dc": {"codec": S3dc(block=(8, 8, 8), bits=4), "brick": 64},
        "lossless": {"codec": None, "brick": 64},
        "lossless-32": {"codec": None, "brick": 32},
    }
    for name, options in variants.items():
        ingest(HEAD, folder / f"{name}.zarr", **options)  # type: ignore[arg-type]
    return {name: open_volume(folder / f"{name}.zarr") for name in variants}


def picture(renderer: Renderer, volume: Volume, preset: str) -> NDArray[np.uint8]:
    camera = Camera.orbit(volume, azimuth=30, elevation=15, distance=700)
    transfer = TransferFunction.preset(preset)
    image = renderer.render(volume, camera, transfer, size=(384, 384), background=(0, 0, 0))
    rgb = image.rgba[..., :3]
    assert np.mean(rgb.max(axis=-1) > 16) > 0.1, "the head does not fill the picture"
    return rgb


@pytest.mark.parametrize("preset", ["ct-bone", "ct-soft-tissue"])
def test_four_bits_and_blocks_of_8_cost_less_than_40_db_and_ssim_097(
    head: dict[str, Volume], preset: str
) -> None:
    with Renderer() as renderer:
        exact = picture(renderer, head["lossless"], preset)
        coded = picture(renderer, head["s3dc"], preset)
    assert metrics.psnr(exact, coded, peak=255) >= 40
    assert metrics.ssim(exact, coded, peak=255) >= 0.97
    assert not np.array_equal(exact, coded)


def test_bricks_of_32_and_64_voxels_give_the_same_picture(head: dict[str, Volume]) -> None:
    with Renderer() as renderer:
        small = picture(renderer, head["lossless-32"], "ct-bone")
        large = picture(renderer, head["lossless"], "ct-bone")
    assert metrics.psnr(large, small, peak=255) >= 50
