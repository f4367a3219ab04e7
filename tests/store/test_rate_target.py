"""Codecs that are found for a PSNR or a ratio."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import InvalidInputError
from octobrick.store import Volume, ingest, open_volume
from octobrick.store.errors import IngestCancelledError, ResumeError

from .conftest import smooth

Ingested = Callable[..., Volume]


@pytest.mark.parametrize("codec", [S3dc((4, 4, 4)), Zerobit()], ids=["s3dc", "zerobit"])
def test_a_psnr_is_reached_at_every_level(ingested: Ingested, codec: S3dc | Zerobit) -> None:
    volume = ingested(smooth((80, 70, 90)), codec=codec, psnr=38.0, brick=32)
    for level in volume.levels:
        assert level.psnr_db == pytest.approx(38, abs=0.5)


def test_a_ratio_is_reached(ingested: Ingested) -> None:
    level = ingested(smooth((80, 70, 90)), ratio=8.0, brick=32, shard=2).levels[0]
    assert level.nbytes / level.stored_nbytes == pytest.approx(8, rel=0.1)


def test_a_psnr_beyond_the_codec_is_kept_exactly(ingested: Ingested) -> None:
    voxels = smooth((40, 40, 40), "uint8")
    np.testing.assert_array_equal(ingested(voxels, psnr=300, brick=16).read(0), voxels)


def test_a_ratio_out_of_reach_is_refused_with_what_is_in_reach(
    ingested: Ingested, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInputError, match="comes to a ratio of"):
        ingested(smooth((40, 40, 40)), ratio=1e6, brick=16)
    assert [path.name for path in tmp_path.iterdir()] == ["volume.npy"]


@pytest.mark.parametrize(
    "options",
    [{"psnr": 40, "ratio": 2}, {"psnr": -1}, {"ratio": 0.5}, {"psnr": float("nan")},
     {"psnr": 40, "codec": None}, {"psnr": 40, "codec": S3dc(bits=2)},
     {"ratio": 4, "codec": (S3dc(), None)}, {"ratio": 4, "labels": True}],
)  # fmt: skip
def test_options_that_exclude_each_other_are_refused(
    ingested: Ingested, options: dict[str, object]
) -> None:
    with pytest.raises(InvalidInputError):
        ingested(smooth((8, 8, 8)), brick=8, **options)


def test_a_resumed_ingest_goes_on_with_the_same_codecs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("octobrick.store.piece_reader.READ_NBYTES", 8 * 2 * 40 * 40)
    np.save(tmp_path / "v.npy", smooth((60, 40, 40)))
    options = {"psnr": 40.0, "brick": 16, "checkpoint_seconds": 0.0}
    ingest(tmp_path / "v.npy", tmp_path / "whole.zarr", **options)  # type: ignore[arg-type]
    cancel = threading.Event()

    def stop(progress: object) -> None:
        if getattr(progress, "done_voxels", 0) > 0:
            cancel.set()

    dest = tmp_path / "v.zarr"
    with pytest.raises(IngestCancelledError):
        ingest(tmp_path / "v.npy", dest, progress=stop, cancel=cancel, **options)  # type: ignore[arg-type]
    with pytest.raises(ResumeError, match="psnr"):
        ingest(tmp_path / "v.npy", dest, **(options | {"psnr": 41.0}))  # type: ignore[arg-type]
    monkeypatch.setattr("octobrick.store.level_codecs.read_probes", None)  # not measured again
    ingest(tmp_path / "v.npy", dest, **options)  # type: ignore[arg-type]
    with open_volume(dest) as found, open_volume(tmp_path / "whole.zarr") as wanted:
        assert found.revision == wanted.revision
