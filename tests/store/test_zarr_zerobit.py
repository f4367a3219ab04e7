"""Zerobit in Zarr v3: zarr-python alone writes and reads it, in shards too; bad input is named."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from numpy.typing import NDArray
from zarr.codecs import TransposeCodec, ZstdCodec

from octobrick.codec import Zerobit
from octobrick.codec.errors import (
    CorruptBrickError,
    InvalidInputError,
    NotFiniteError,
    OctobrickError,
    UnsupportedError,
)
from octobrick.store.zarr_zerobit import ZEROBIT_NAME, ZerobitZarrCodec

from .conftest import smooth

DTYPES = ["uint8", "int8", "uint16", "int16", "float32"]
GIVEN = {"version": 1, "codebook": None}


def coloured(shape_zyx: tuple[int, int, int], dtype: str = "uint8") -> NDArray[Any]:
    """Colours, last."""
    grey = smooth(shape_zyx, dtype)
    return np.stack([grey, grey // 2, grey // 3], axis=-1)


def round_trip(codec: Zerobit, image: NDArray[Any]) -> NDArray[Any]:
    return codec.decode(codec.encode(image), image.shape, image.dtype)


def written(path: Path, voxels: NDArray[Any], codec: Zerobit, **options: Any) -> zarr.Array:
    """An array of these voxels, opened anew, as somebody would who knows nothing of its codec."""
    array = zarr.create_array(
        path, shape=voxels.shape, dtype=voxels.dtype, serializer=ZerobitZarrCodec(codec), **options
    )
    array[...] = voxels
    return zarr.open_array(path, mode="r")


@pytest.mark.parametrize("dtype", DTYPES)
def test_zarr_python_reads_what_zerobit_decodes(tmp_path: Path, dtype: str) -> None:
    voxels, codec = smooth((32, 16, 48), dtype), Zerobit(0.1)
    array = written(tmp_path / "a", voxels, codec, chunks=(16, 16, 16), compressors=None)
    for z, x in np.ndindex(2, 3):
        brick = (slice(16 * z, 16 * z + 16), slice(0, 16), slice(16 * x, 16 * x + 16))
        np.testing.assert_array_equal(array[brick], round_trip(codec, voxels[brick]), strict=True)


def test_a_chunk_on_disk_is_the_code_and_nothing_else(tmp_path: Path) -> None:
    voxels, codec = smooth((8, 9, 10), "uint16"), Zerobit(0.1)
    written(tmp_path / "a", voxels, codec, chunks=(8, 9, 10), compressors=None)
    assert (tmp_path / "a/c/0/0/0").read_bytes() == codec.encode(voxels)


@pytest.mark.parametrize("dtype", ["int16", ">u2", "float32"])
def test_shards_of_zerobit_under_zstd_are_read_brick_by_brick(tmp_path: Path, dtype: str) -> None:
    voxels, codec = smooth((32, 32, 32), np.dtype(dtype).name)[None, None].astype(dtype), Zerobit()
    array = written(
        tmp_path / "a",
        voxels,
        codec,
        chunks=(1, 1, 16, 16, 16),
        shards=(1, 1, 32, 32, 16),
        compressors=ZstdCodec(level=3, checksum=True),
    )
    expected = round_trip(codec, voxels[0, 0, 16:, :16, 16:])
    np.testing.assert_array_equal(array[0, 0, 16:, :16, 16:], expected)
    np.testing.assert_array_equal(array[...][0, 0, 16:, :16, 16:], expected)


@pytest.mark.parametrize("shards", [None, (1, 3, 32, 16, 16)])
def test_a_channel_axis_next_to_z_holds_the_colours(tmp_path: Path, shards: Any) -> None:
    image, codec = coloured((32, 16, 16), "uint16"), Zerobit(0.1)
    voxels = np.moveaxis(image, 3, 0)[np.newaxis]
    array = written(tmp_path / "a", voxels, codec, chunks=(1, 3, 16, 16, 16), shards=shards)
    expected = np.moveaxis(round_trip(codec, image[16:]), 3, 0)
    np.testing.assert_array_equal(array[0, :, 16:], expected)


@pytest.mark.parametrize("shards", [None, (32, 16, 16, 3)])
def test_colours_that_come_last_are_transposed_by_zarr(tmp_path: Path, shards: Any) -> None:
    image, codec = coloured((32, 16, 16)), Zerobit(0.1)
    array = written(
        tmp_path / "a",
        image,
        codec,
        chunks=(16, 16, 16, 3),
        shards=shards,
        filters=[TransposeCodec(order=(3, 0, 1, 2))],
    )
    np.testing.assert_array_equal(array[16:], round_trip(codec, image[16:]))


def test_three_voxels_in_x_are_no_colours(tmp_path: Path) -> None:
    voxels, codec = smooth((8, 8, 3), "uint8"), Zerobit(1)
    array = written(tmp_path / "a", voxels[None], codec, chunks=(1, 8, 8, 3))
    np.testing.assert_array_equal(array[0], round_trip(codec, voxels))


def test_a_shared_codebook_lies_in_the_metadata_and_in_no_chunk(tmp_path: Path) -> None:
    voxels = smooth((16, 16, 32), "uint8")
    bricks = [voxels[:, :, :16], voxels[:, :, 16:]]
    shared = Zerobit(0.1, codebook=Zerobit.train(bricks, like=Zerobit(0.1)))
    array = written(tmp_path / "a", voxels, shared, chunks=(16, 16, 16), compressors=None)
    np.testing.assert_array_equal(array[:, :, 16:], round_trip(shared, bricks[1]))
    code = (tmp_path / "a/c/0/0/0").read_bytes()
    assert shared.stats(code).codebook_nbytes == 0
    with pytest.raises(CorruptBrickError, match="shared codebook"):
        Zerobit().decode(code, (16, 16, 16), "uint8")


@pytest.mark.parametrize(
    "codec",
    [
        Zerobit(),
        Zerobit(0.2, thresholds="block", ranking="literal", count_averages=True, background=7),
        Zerobit(0, background=(1.0, 2.0, 3.0)),
        Zerobit(codebook=Zerobit.train([np.arange(64, dtype=np.int16).reshape(4, 4, 4)])),
    ],
)
def test_a_configuration_survives_json(codec: Zerobit) -> None:
    text = json.dumps(ZerobitZarrCodec(codec).to_dict())
    assert ZerobitZarrCodec.from_dict(json.loads(text)) == ZerobitZarrCodec(codec)


def test_a_reader_needs_version_and_codebook_only(tmp_path: Path) -> None:
    voxels, codec = smooth((8, 8, 8), "uint8"), Zerobit(0.3)
    written(tmp_path / "a", voxels, codec, chunks=(8, 8, 8))
    metadata = json.loads((tmp_path / "a/zarr.json").read_text())
    metadata["codecs"][0]["configuration"] = GIVEN
    (tmp_path / "a/zarr.json").write_text(json.dumps(metadata))
    array = zarr.open_array(tmp_path / "a", mode="r")
    np.testing.assert_array_equal(array[...], round_trip(codec, voxels))


@pytest.mark.parametrize(
    "configuration",
    [
        {},
        {"version": 1},
        {"codebook": None},
        {**GIVEN, "bits": 4},
        {**GIVEN, "ratio": 1.5},
        {**GIVEN, "ratio": "much"},
        {**GIVEN, "ratio": True},
        {**GIVEN, "ratio": float("nan")},
        {**GIVEN, "thresholds": "local"},
        {**GIVEN, "thresholds": []},
        {**GIVEN, "ranking": None},
        {**GIVEN, "count_averages": 1},
        {**GIVEN, "background": "black"},
        {**GIVEN, "background": [1, 2]},
        {**GIVEN, "background": [1, 2, True]},
        {**GIVEN, "codebook": "not base64"},
        {**GIVEN, "codebook": 7},
        {**GIVEN, "codebook": "é"},
    ],
)
def test_a_configuration_that_is_not_ours_is_refused(configuration: Any) -> None:
    with pytest.raises(InvalidInputError, match=r"octobrick\.zerobit|Zerobit"):
        ZerobitZarrCodec.from_dict({"name": ZEROBIT_NAME, "configuration": configuration})


@pytest.mark.parametrize("data", [b"", b"OBZC", b"OBZC" + bytes(12), b"\xff" * 99])
def test_a_codebook_that_is_none_is_refused_when_the_array_is_opened(
    tmp_path: Path, data: bytes
) -> None:
    written(tmp_path / "a", smooth((8, 8, 8), "uint8"), Zerobit(), chunks=(8, 8, 8))
    metadata = json.loads((tmp_path / "a/zarr.json").read_text())
    codebook = base64.b64encode(data).decode()
    metadata["codecs"][0]["configuration"] = {"version": 1, "codebook": codebook}
    (tmp_path / "a/zarr.json").write_text(json.dumps(metadata))
    with pytest.raises(InvalidInputError, match="codebook"):
        zarr.open_array(tmp_path / "a", mode="r")


@pytest.mark.parametrize("version", [2, 0, "1", None, [1]])
def test_an_unknown_version_is_refused_with_advice(version: Any) -> None:
    given = {"name": ZEROBIT_NAME, "configuration": {**GIVEN, "version": version, "new": 1}}
    with pytest.raises(UnsupportedError, match=r"version .* install a newer octobrick"):
        ZerobitZarrCodec.from_dict(given)  # type: ignore[arg-type]


@pytest.mark.parametrize("shards", [None, (16, 16, 16)])
@pytest.mark.parametrize(
    ("dtype", "codec", "message"),
    [
        ("f8", Zerobit(), "float64"),
        ("u1", Zerobit(background=-1), "background"),
        ("i2", Zerobit(codebook=Zerobit.train([np.ones((4, 4, 4), np.uint8)])), "codebook"),
    ],
)
def test_an_array_that_it_cannot_hold_is_refused_when_it_is_made(
    dtype: str, codec: Zerobit, message: str, shards: Any
) -> None:
    with pytest.raises(OctobrickError, match=message):
        zarr.create_array(
            {}, shape=(16, 16, 16), chunks=(8, 8, 8), shards=shards, dtype=dtype,
            serializer=ZerobitZarrCodec(codec),
        )  # fmt: skip


@pytest.mark.parametrize(
    ("chunks", "dtype", "message"),
    [
        ((8, 8), "u1", "axes z, y, x"),
        ((2, 8, 8, 8), "u1", "next to z may be 3"),
        ((2, 3, 8, 8, 8), "u1", "next to z may be 3"),
        ((1, 3, 8, 8, 8), "f4", "no float32 colours"),
    ],
)
def test_chunks_that_are_not_one_brick_are_refused_when_the_array_is_made(
    chunks: tuple[int, ...], dtype: str, message: str
) -> None:
    with pytest.raises(OctobrickError, match=message):
        zarr.create_array(
            {}, shape=chunks, chunks=chunks, dtype=dtype, serializer=ZerobitZarrCodec()
        )


@pytest.mark.parametrize(("chunks", "shards"), [((8, 8, 8, 3), None), ((2, 8, 8, 8), (4, 8, 8, 8))])
def test_chunks_that_zarr_does_not_show_beforehand_are_refused_when_they_come(
    chunks: tuple[int, ...], shards: tuple[int, ...] | None
) -> None:
    """Before a transpose colours may come last, and what lies in a shard is not validated."""
    array = zarr.create_array(
        {}, shape=shards or chunks, chunks=chunks, shards=shards, dtype="u1",
        serializer=ZerobitZarrCodec(),
    )  # fmt: skip
    with pytest.raises(InvalidInputError, match="transpose"):
        array[...] = 1


def test_a_voxel_that_is_not_finite_is_named(tmp_path: Path) -> None:
    voxels = np.zeros((8, 8, 8), np.float32)
    voxels[1, 2, 3] = np.nan
    with pytest.raises(NotFiniteError, match=r"\(1, 2, 3\)"):
        written(tmp_path / "a", voxels, Zerobit(), chunks=(8, 8, 8))


def test_damaged_chunks_are_corrupt_bricks(tmp_path: Path) -> None:
    voxels = smooth((8, 8, 16), "uint8")
    array = written(tmp_path / "a", voxels, Zerobit(0.3), chunks=(8, 8, 8), compressors=None)
    path = tmp_path / "a/c/0/0/0"
    code = path.read_bytes()
    other_type = Zerobit().encode(voxels[:, :, :8].astype(np.int16))
    other_shape = Zerobit().encode(voxels[:, :, :7])
    for damaged in (b"", code[:-1], code + b"\0", b"\xff" * len(code), other_type, other_shape):
        path.write_bytes(damaged)
        with pytest.raises(CorruptBrickError):
            array[:, :, :8]
    assert array[:, :, 8:].any()


def test_any_one_byte_damaged_gives_voxels_or_a_corrupt_brick(tmp_path: Path) -> None:
    voxels = smooth((8, 8, 8), "uint8")
    array = written(tmp_path / "a", voxels, Zerobit(0.3), chunks=(8, 8, 8), compressors=None)
    path = tmp_path / "a/c/0/0/0"
    code = bytearray(path.read_bytes())
    refused = 0
    for at in range(len(code)):
        code[at] ^= 0x55
        path.write_bytes(code)
        code[at] ^= 0x55
        try:
            assert array[...].shape == voxels.shape
        except CorruptBrickError:
            refused += 1
    assert refused > 64  # the header is refused but for averages, thresholds and the like
