"""Chunks for other readers: kept once made, never those of a volume that was replaced."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zstandard

from octobrick.codec.errors import UnsupportedError
from octobrick.server.interop import precomputed
from octobrick.store import open_volume

CHUNK = "/zarr/head/0/c/0/0/1/0/2"


def test_a_chunk_is_made_once_and_a_lossless_one_never(client: Any) -> None:
    stats = client.app.state.services.chunks.stats
    for _ in range(2):
        assert client.get(CHUNK).status_code == 200
        assert client.get(CHUNK.replace("head", "exact")).status_code == 200
    assert (stats()["misses_total"], stats()["hits_total"]) == (1, 1)


def test_a_chunk_is_that_of_the_volume_that_is_there_now(
    client: Any, data_dir: Path, replace_volume: Callable[[str], None]
) -> None:
    old = client.get(CHUNK)
    replace_volume("head")
    new = client.get(CHUNK, headers={"if-none-match": old.headers["etag"]})
    assert new.status_code == 200
    with open_volume(data_dir / "head.zarr") as volume:
        found = np.frombuffer(zstandard.decompress(new.content), "<u2").reshape(16, 16, 16)
        np.testing.assert_array_equal(found, volume.brick(0, (1, 0, 2)))


def test_a_volume_that_is_replaced_between_two_looks_is_looked_at_again(
    client: Any, data_dir: Path, replace_volume: Callable[[str], None]
) -> None:
    chunks = client.app.state.services.chunks
    get, replaced = chunks.get, []

    def replace_first(key: Any, make: Any) -> Any:
        if not replaced:
            replaced.append(key)
            replace_volume("head")
        return get(key, make)

    chunks.get = replace_first
    reply = client.get(CHUNK)
    with open_volume(data_dir / "head.zarr") as volume:
        assert reply.headers["etag"].startswith(f'"{volume.revision}-')
        found = np.frombuffer(zstandard.decompress(reply.content), "<u2").reshape(16, 16, 16)
        np.testing.assert_array_equal(found, volume.brick(0, (1, 0, 2)))
    assert chunks.stats()["entries"] == 1, "nothing is kept under the old revision"


def test_a_damaged_brick_is_an_error_of_its_own(
    client: Any, data_dir: Path, error_of: Callable[[Any], dict[str, Any]]
) -> None:
    with open_volume(data_dir / "head.zarr") as volume:
        stored = volume.stored_brick(0, (1, 0, 2))
    assert stored is not None
    shard = data_dir / "head.zarr" / "0" / "c" / "0" / "0" / "0" / "0" / "0"
    content = bytearray(shard.read_bytes())
    content[content.index(stored) + len(stored) // 2] ^= 0xFF
    shard.write_bytes(content)
    for target in (CHUNK, "/precomputed/head/0/32-48_0-16_16-32"):
        reply = client.get(target)
        assert (reply.status_code, error_of(reply)["kind"]) == (500, "corrupt-brick")
        assert str(data_dir) not in reply.text
    assert client.get(CHUNK.replace("1/0/2", "1/0/1")).status_code == 200


@pytest.mark.parametrize(
    ("unit", "nanometers"),
    [("nanometer", 1.0), ("micrometer", 1e3), ("millimeter", 1e6), (None, 1.0), ("furlong", 1.0)],
)
def test_a_voxel_has_its_size_in_nanometres(unit: str | None, nanometers: float) -> None:
    found = precomputed.resolution_nanometers_xyz((0.5, 1.0, 2.0), unit)
    assert found == [0.5 * nanometers, nanometers, 2 * nanometers]


def test_what_the_precomputed_format_cannot_hold_is_refused_with_the_reason() -> None:
    fine: dict[str, Any] = {"dtype": np.dtype("u2"), "brick_shape_zyx": (64, 64, 64), "nc": 3}
    precomputed.require_supported(SimpleNamespace(**fine))  # type: ignore[arg-type]
    for wrong, text in (({"dtype": np.dtype("f8")}, "float64"), ({"nc": 257}, "257 channels")):
        with pytest.raises(UnsupportedError, match=text):
            precomputed.require_supported(SimpleNamespace(**fine | wrong))  # type: ignore[arg-type]
    with pytest.raises(UnsupportedError, match="no size"):
        precomputed.resolution_nanometers_xyz((1.0, 1.0, math.nextafter(math.inf, 0)), "meter")
