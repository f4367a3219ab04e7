"""Volumes whose levels have codecs of their own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import InvalidInputError
from octobrick.store import Volume, ingest, open_volume
from octobrick.store.attributes import VolumeAttributes
from octobrick.store.errors import VolumeFormatError
from octobrick.store.repair import repair
from octobrick.store.sources import open_source
from octobrick.store.verify import verify
from octobrick.store.verify_source import verify_against

from .conftest import smooth

Ingested = Callable[..., Volume]
CODECS = (S3dc((4, 4, 4), slope=30), Zerobit(0.1), S3dc(bits=4), None)


@pytest.fixture
def mixed(ingested: Ingested) -> Volume:
    return ingested(smooth((70, 66, 90), "int16"), codec=CODECS, brick=16, shard=2, levels=5)


def test_each_level_says_and_has_its_own(mixed: Volume) -> None:
    assert tuple(mixed.level_codec(i) for i in range(5)) == (*CODECS, None)
    assert mixed.codec == CODECS[0]
    assert [level.max_error > 0 for level in mixed.levels] == [True, True, True, False, False]
    assert verify(mixed.path).sound


def test_zarr_python_reads_all_of_them(mixed: Volume) -> None:
    names = []
    for level in mixed.levels:
        array = zarr.open_array(mixed.path / str(level.index), mode="r")
        np.testing.assert_array_equal(array[0, 0], mixed.read(level.index), strict=True)
        metadata = json.loads((mixed.path / str(level.index) / "zarr.json").read_text())
        names.append(metadata["codecs"][0]["configuration"]["codecs"][0]["name"])
    assert names == ["octobrick.s3dc", "octobrick.zerobit", "octobrick.s3dc", "bytes", "bytes"]


def test_damage_at_any_level_is_mended(mixed: Volume, tmp_path: Path) -> None:
    with open_source(tmp_path / "volume.npy") as source:
        assert verify_against(mixed.path, source).sound
        shards = [mixed.path / f"{level}/c/0/0/0/0/0" for level in range(5)]
        before = [shard.read_bytes() for shard in shards]
        for shard, data in zip(shards, before, strict=True):
            shard.write_bytes(data[:60] + bytes([data[60] ^ 1]) + data[61:])
        assert not repair(mixed.path, source).left
    assert [shard.read_bytes() for shard in shards] == before


def test_the_result_names_the_codecs(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", smooth((20, 20, 20)))
    result = ingest(tmp_path / "v.npy", tmp_path / "v.zarr", codec=(S3dc(), None), brick=16)
    assert [level.codec for level in result.levels] == [S3dc(), None]
    first, second = json.loads(json.dumps(result.to_dict()))["levels"]
    assert first["codec"]["configuration"]["bits"] == 4
    assert second["codec"] == {"name": "bytes"}


def test_a_volume_of_one_codec_does_not_repeat_it(ingested: Ingested) -> None:
    volume = ingested(smooth((40, 40, 40)), brick=16)
    assert all("codec" not in level for level in volume.metadata()["levels"])
    assert all(volume.level_codec(i) == volume.codec for i in range(len(volume.levels)))


@pytest.mark.parametrize(
    "codec",
    [{"name": "jpeg"}, {"name": "octobrick.s3dc", "configuration": {"version": 1}}, None, 3,
     {"name": "octobrick.zerobit", "configuration": {"version": 1, "codebook": "AAAA"}}],
)  # fmt: skip
def test_a_codec_that_is_none_is_refused(mixed: Volume, codec: object) -> None:
    fields = json.loads((mixed.path / "zarr.json").read_text())["attributes"]["octobrick"]
    fields["levels"][1]["codec"] = codec
    with pytest.raises(VolumeFormatError, match=r"here: (codec|octobrick|.*codebook)"):
        VolumeAttributes.from_json(fields, "here")


@pytest.mark.parametrize("codec", [(), (None, None, None)])
def test_no_codec_or_more_than_levels_is_refused(
    ingested: Ingested, codec: tuple[None, ...]
) -> None:
    with pytest.raises(InvalidInputError, match="one for all"):
        ingested(smooth((20, 20, 20)), codec=codec, brick=16)


def test_a_level_that_does_not_exist_has_none(mixed: Volume) -> None:
    with pytest.raises(InvalidInputError, match="level 5"):
        mixed.level_codec(5)
    assert "s3dc; block=4,4,4; slope=30" in repr(open_volume(mixed.path))
