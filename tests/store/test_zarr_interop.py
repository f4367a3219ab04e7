"""Other readers of Zarr v3 understand what we write."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import tensorstore
import zarr

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError, OctobrickError, UnsupportedError
from octobrick.store import Volume
from octobrick.store.verify import verify
from octobrick.store.zarr_codec import S3dcZarrCodec

from .conftest import smooth

Ingested = Callable[..., Volume]
DTYPES = ["uint8", "int8", "uint16", "int16", "float32"]


@pytest.mark.parametrize("dtype", DTYPES)
def test_zarr_python_reads_every_level_of_an_s3dc_volume_as_we_do(
    ingested: Ingested, dtype: str
) -> None:
    volume = ingested(smooth((37, 50, 41), dtype), codec=S3dc(bits=4), brick=16, shard=2)
    group = zarr.open_group(volume.path, mode="r")
    for level in volume.levels:
        array = group[str(level.index)]
        assert isinstance(array, zarr.Array)
        np.testing.assert_array_equal(array[0, 0], volume.read(level.index), strict=True)


@pytest.mark.parametrize("dtype", DTYPES)
def test_tensorstore_reads_every_level_of_a_lossless_volume_without_us(
    ingested: Ingested, dtype: str
) -> None:
    voxels = smooth((37, 50, 41), dtype)
    voxels[:20] = 0  # some bricks are absent
    volume = ingested(voxels, codec=None, brick=16, shard=2)
    for level in volume.levels:
        path = str(volume.path / str(level.index))
        spec = {"driver": "zarr3", "kvstore": {"driver": "file", "path": path}}
        array = tensorstore.open(spec, read=True).result()
        np.testing.assert_array_equal(array[0, 0].read().result(), volume.read(level.index))


def test_ome_metadata_places_every_level_where_its_voxels_are(ingested: Ingested) -> None:
    volume = ingested(smooth((40, 40, 40)), brick=16, spacing=(3.0, 1.5, 0.5))
    ome = zarr.open_group(volume.path, mode="r").attrs["ome"]
    assert ome["version"] == "0.5"
    (image,) = ome["multiscales"]
    assert [axis["name"] for axis in image["axes"]] == ["t", "c", "z", "y", "x"]
    for level, dataset in zip(volume.levels, image["datasets"], strict=True):
        scale, translation = dataset["coordinateTransformations"]
        assert tuple(reversed(scale["scale"][2:])) == level.spacing_xyz
        assert tuple(reversed(translation["translation"][2:])) == level.origin_xyz


@pytest.mark.parametrize(
    "codec",
    [S3dc(bits=8), S3dc((4, 4, 4), max_error=0), S3dc(bits_per_voxel=3.5, fitted=False),
     S3dc(slope=20), S3dc(bits=2, fitted=True), S3dc(bits=3, scale="trained")],
    ids=str,
)  # fmt: skip
def test_zarr_python_writes_and_reads_through_our_codec(
    tmp_path_factory: pytest.TempPathFactory, codec: S3dc
) -> None:
    path = tmp_path_factory.mktemp("zarr") / "array"
    voxels = smooth((20, 20, 20), "uint8")
    array = zarr.create_array(
        path,
        shape=voxels.shape,
        chunks=(8, 8, 8),
        shards=(16, 16, 16),
        dtype="uint8",
        serializer=S3dcZarrCodec(codec),
    )
    array[...] = voxels
    found = zarr.open_array(path, mode="r")
    brick = voxels[8:16, :8, :8]
    expected = codec.decode(codec.encode(brick), brick.shape, brick.dtype)
    np.testing.assert_array_equal(found[8:16, :8, :8], expected)
    assert S3dcZarrCodec.from_dict(S3dcZarrCodec(codec).to_dict()).codec == codec


def test_volumes_of_codes_that_no_renderer_decodes_are_refused(ingested: Ingested) -> None:
    with pytest.raises(UnsupportedError, match="with a linear scale"):
        ingested(smooth((8, 8, 8)), codec=S3dc(bits=4, scale="trained"), brick=8, shard=2)


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
def test_a_volume_with_a_bound_keeps_it_and_is_read_by_zarr(ingested: Ingested, dtype: str) -> None:
    voxels = smooth((40, 50, 30), dtype)
    volume = ingested(voxels, codec=S3dc((4, 4, 4), max_error=3), brick=16, shard=2)
    found = volume.read(0)
    assert np.abs(found.astype(np.float64) - voxels).max() <= 3
    assert all(level.max_error <= 3 for level in volume.levels)
    assert verify(volume.path).sound
    np.testing.assert_array_equal(zarr.open_array(volume.path / "0", mode="r")[0, 0], found)


def test_a_volume_with_a_budget_stays_below_it(ingested: Ingested) -> None:
    volume = ingested(smooth((64, 64, 64)), codec=S3dc((4, 4, 4), bits_per_voxel=2), levels=1)
    code = volume.brick_code(0, (0, 0, 0))
    assert code is not None
    assert len(code) * 8 <= 2 * 64**3
    assert verify(volume.path).sound


def test_an_array_that_the_codec_cannot_hold_is_refused_when_it_is_made() -> None:
    with pytest.raises(UnsupportedError, match="float64"):
        zarr.create_array(
            {}, shape=(8, 8, 8), chunks=(8, 8, 8), dtype="f8", serializer=S3dcZarrCodec()
        )
    with pytest.raises(InvalidInputError, match="axes"):
        zarr.create_array({}, shape=(8, 8), chunks=(8, 8), dtype="u1", serializer=S3dcZarrCodec())


@pytest.mark.parametrize(
    "configuration",
    [{}, {"version": 2, "block": [8, 8, 8], "bits": 4}, {"version": 1, "block": [8, 8], "bits": 4},
     {"version": 1, "block": [0, 8, 8], "bits": 4}, {"version": 1, "block": [8, 8, 8], "bits": 9},
     {"version": 1, "block": [8, 8, 8], "bits": True}, {"version": 1, "block": [8, 8, 8]},
     {"version": 1, "block": [8, 8, 8], "bits": 4, "max_error": 2.0},
     {"version": 1, "block": [8, 8, 8], "bits": 4, "colour": 2},
     {"version": 1, "block": "888", "bits": 4}],
)  # fmt: skip
def test_a_configuration_that_is_not_ours_is_refused(configuration: dict[str, object]) -> None:
    with pytest.raises(OctobrickError, match=r"octobrick\.s3dc|S3dc|block|bits"):
        S3dcZarrCodec.from_dict({"name": "octobrick.s3dc", "configuration": configuration})  # type: ignore[dict-item]
