"""Health, the list of volumes, and the metadata of one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from octobrick.store import open_volume


def test_health(client: Any) -> None:
    reply = client.get("/healthz")
    assert reply.status_code == 200
    assert reply.json() == {"status": "ok"}


def test_list_has_every_volume_and_the_kind_of_what_is_wrong_with_it(client: Any) -> None:
    reply = client.get("/v1/volumes")
    assert reply.headers["cache-control"] == "no-cache"
    volumes = {volume.pop("id"): volume for volume in reply.json()["volumes"]}
    assert list(volumes) == ["exact", "head", "plain", "torn"]
    assert volumes["torn"] == {"available": False, "error_kind": "corrupt-volume"}
    assert volumes["plain"]["available"] is False
    head = volumes["head"]
    assert len(head.pop("revision")) == 32
    assert head == {"available": True, "dtype": "uint16", "shape_zyx": [40, 36, 50], "levels": 3}


def test_list_follows_the_folder(
    client: Any, data_dir: Path, replace_volume: Callable[[str], None]
) -> None:
    def revisions() -> dict[str, str | None]:
        volumes = client.get("/v1/volumes").json()["volumes"]
        return {volume["id"]: volume.get("revision") for volume in volumes}

    before = revisions()
    replace_volume("head")
    shutil.rmtree(data_dir / "torn.zarr")
    after = revisions()
    assert after.keys() == before.keys() - {"torn"}
    assert after["head"] != before["head"]
    assert after["exact"] == before["exact"]


def test_metadata_tells_what_a_client_needs(client: Any, data_dir: Path) -> None:
    reply = client.get("/v1/volumes/head")
    assert reply.status_code == 200
    detail = reply.json()
    with open_volume(data_dir / "head.zarr") as volume:
        assert detail["revision"] == volume.revision
        assert detail["codec"] == "s3dc; block=8,8,8; bits=4"
        assert detail["value_range"] == list(volume.value_range)
        assert detail["window"] == list(volume.window)
        assert [level["grid_zyx"] for level in detail["levels"]] == [
            list(level.grid_zyx) for level in volume.levels
        ]
        assert [level["max_error"] for level in detail["levels"]] == [
            level.max_error for level in volume.levels
        ]
        address = detail["bricks"].format(level=0, t=0, c=0, z=1, y=0, x=2)
        assert client.get(address).content == volume.brick_code(0, (1, 0, 2))


def test_metadata_of_a_lossless_volume_says_that_nothing_was_lost(client: Any) -> None:
    detail = client.get("/v1/volumes/exact").json()
    assert detail["codec"] == "raw"
    assert {level["psnr_db"] for level in detail["levels"]} == {None}
    assert {level["max_error"] for level in detail["levels"]} == {0.0}


def test_unknown_volume_is_404(client: Any, error_of: Callable[[Any], dict[str, Any]]) -> None:
    reply = client.get("/v1/volumes/tail")
    assert reply.status_code == 404
    error = error_of(reply)
    assert error["kind"] == "volume-not-found"
    assert error["facts"] == {"id": "tail"}


def test_broken_volume_is_500_without_a_path_and_harms_no_other(
    client: Any, data_dir: Path, error_of: Callable[[Any], dict[str, Any]]
) -> None:
    reply = client.get("/v1/volumes/torn")
    assert reply.status_code == 500
    assert error_of(reply)["kind"] == "corrupt-volume"
    assert str(data_dir) not in reply.text
    assert client.get("/v1/volumes/head").status_code == 200


def test_a_volume_that_breaks_in_a_way_that_nobody_foresaw_is_listed_too(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("octobrick.server.models.VolumeSummary.of", fail)
    volumes = {v["id"]: v for v in client.get("/v1/volumes").json()["volumes"]}
    assert volumes["head"] == {"id": "head", "available": False, "error_kind": "internal"}
    assert volumes["torn"]["error_kind"] == "corrupt-volume"
