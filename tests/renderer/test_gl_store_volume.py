"""A volume on disk fits the protocol, and looks as the same bricks in memory do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit
from octobrick.renderer import BrickSource, Camera, Renderer, TransferFunction
from octobrick.store import ingest, open_volume

from .array_source import ArraySource

pytestmark = pytest.mark.gl


@pytest.mark.parametrize("codec", [S3dc(), None])
def test_a_stored_volume_looks_as_in_memory(
    renderer: Renderer, blobs: NDArray[np.uint8], tmp_path: Path, codec: S3dc | None
) -> None:
    np.save(tmp_path / "blobs.npy", blobs)
    ingest(tmp_path / "blobs.npy", tmp_path / "blobs.zarr", codec=codec, brick=16)
    memory = ArraySource(blobs, codec=codec, brick=16)
    function = TransferFunction.preset("ct-soft-tissue")
    with open_volume(tmp_path / "blobs.zarr") as volume:
        source: BrickSource = volume  # what mypy checks
        assert len(source.levels) == len(memory.levels)
        for level in range(len(memory.levels)):
            camera = Camera.orbit(source, 30, 20)
            found, wanted = (
                renderer.render(each, camera, function, (50, 40), window=(0, 250), level=level)
                for each in (source, memory)
            )
            np.testing.assert_array_equal(found.premultiplied, wanted.premultiplied)
            assert found.fidelity == wanted.fidelity
            assert found.stats.bricks == wanted.stats.bricks


@pytest.mark.parametrize("codec", [S3dc((4, 4, 4), max_error=9), Zerobit(0.05)], ids=str)
def test_bricks_that_the_gpu_does_not_decode_look_as_their_voxels_do(
    renderer: Renderer, blobs: NDArray[np.uint8], tmp_path: Path, codec: S3dc | Zerobit
) -> None:
    np.save(tmp_path / "blobs.npy", blobs)
    ingest(tmp_path / "blobs.npy", tmp_path / "blobs.zarr", codec=codec, brick=16, levels=1)
    with open_volume(tmp_path / "blobs.zarr") as volume:
        memory = ArraySource(volume.read(0), codec=None, brick=16)
        found, wanted = (
            renderer.render(
                each,
                Camera.orbit(volume, 30, 20),
                TransferFunction.preset("ct-soft-tissue"),
                (50, 40),
                window=(0, 250),
                level=0,
            )
            for each in (volume, memory)
        )
        np.testing.assert_array_equal(found.rgba, wanted.rgba)
        assert found.fidelity.max_error == volume.fidelity(0)[..., 0].max() > 0


def test_every_level_is_decoded_where_its_own_codec_is(
    renderer: Renderer, blobs: NDArray[np.uint8], tmp_path: Path
) -> None:
    np.save(tmp_path / "blobs.npy", blobs)
    codecs = (S3dc((4, 4, 4), max_error=9), S3dc(), None)
    ingest(tmp_path / "blobs.npy", tmp_path / "mixed.zarr", codec=codecs, brick=16, levels=3)
    for level, codec in enumerate(codecs):
        alone = tmp_path / f"{level}.zarr"
        ingest(tmp_path / "blobs.npy", alone, codec=codec, brick=16, levels=3)
        with open_volume(tmp_path / "mixed.zarr") as mixed, open_volume(alone) as volume:
            found, wanted = (
                renderer.render(
                    each,
                    Camera.orbit(each, 30, 20),
                    TransferFunction.preset("ct-soft-tissue"),
                    (50, 40),
                    window=(0, 250),
                    level=level,
                )
                for each in (mixed, volume)
            )
        np.testing.assert_array_equal(found.rgba, wanted.rgba)
        assert found.stats.uploaded_nbytes == wanted.stats.uploaded_nbytes > 0
