"""Attributes and tables: what a client needs to open a volume and to select by itself."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octobrick.store import open_volume
from octobrick.store.attributes import VolumeAttributes


def test_attributes_are_those_of_the_volume_for_ever(
    client: Any, revision: str, data_dir: Path
) -> None:
    path = f"/v1/volumes/head/{revision}/attributes"
    reply = client.get(path)
    written = json.loads((data_dir / "head.zarr" / "zarr.json").read_text())
    assert reply.json() == written["attributes"]["octobrick"]
    assert VolumeAttributes.from_json(reply.json(), "http").nt == 1
    assert "immutable" in reply.headers["cache-control"]
    again = client.get(path, headers={"if-none-match": reply.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


@pytest.mark.parametrize("kind", ["range", "fidelity"])
@pytest.mark.parametrize("level", [0, 2])
def test_a_table_has_the_values_of_the_volume_in_either_encoding(
    client: Any, revision: str, data_dir: Path, kind: str, level: int
) -> None:
    volume = open_volume(data_dir / "head.zarr")
    wanted = (volume.ranges if kind == "range" else volume.fidelity)(level)
    path = f"/v1/volumes/head/{revision}/tables/{kind}/{level}/0/0"
    plain = client.get(path)
    packed = client.get(path, headers={"accept-encoding": "zstd"})
    assert packed.headers["content-encoding"] == "zstd"
    assert plain.headers["etag"] != packed.headers["etag"]
    for reply in (plain, packed):
        assert reply.headers["vary"] == "Accept-Encoding"
        assert "immutable" in reply.headers["cache-control"]
        shape = [int(n) for n in reply.headers["x-octobrick-shape"].split(",")]
        dtype = np.dtype(reply.headers["x-octobrick-dtype"]).newbyteorder("<")
        found = np.frombuffer(reply.content, dtype).reshape(shape)
        np.testing.assert_array_equal(found, wanted)
        again = client.get(
            path,
            headers={
                "if-none-match": reply.headers["etag"],
                "accept-encoding": reply.headers.get("content-encoding", "identity"),
            },
        )
        assert again.status_code == 304


@pytest.mark.parametrize(
    ("path", "status", "kind"),
    [
        ("{revision}/tables/range/9/0/0", 404, "brick-not-found"),
        ("{revision}/tables/range/0/1/0", 404, "brick-not-found"),
        ("{revision}/tables/fidelity/0/0/1", 404, "brick-not-found"),
        ("{revision}/tables/voxels/0/0/0", 422, "invalid-input"),
        ("{revision}/tables/range/-1/0/0", 422, "invalid-input"),
        ("00/tables/range/0/0/0", 410, "revision-gone"),
        ("00/attributes", 410, "revision-gone"),
    ],
)
def test_what_there_is_not_has_its_error(
    client: Any, revision: str, error_of: Callable[[Any], dict[str, Any]], path: str, status: int,
    kind: str,
) -> None:  # fmt: skip
    reply = client.get("/v1/volumes/head/" + path.format(revision=revision))
    assert (reply.status_code, error_of(reply)["kind"]) == (status, kind)


def test_a_table_is_read_and_packed_once(
    client: Any, revision: str, app: Any, data_dir: Path
) -> None:
    path = f"/v1/volumes/head/{revision}/tables/range/0/0/0"
    first = client.get(path).content
    assert client.get(path).content == first
    stats = app.state.services.tables.stats()
    assert (stats["misses_total"], stats["hits_total"], stats["entries"]) == (1, 1, 1)
