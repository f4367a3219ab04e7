"""The bricks that a view needs, over HTTP: the same as the renderer's, bounded and cacheable."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octobrick.codec import S3dc
from octobrick.renderer import TransferFunction, select
from octobrick.server import Settings, create_app
from octobrick.server.bricks.selection import SelectBody, answer
from octobrick.server.catalog import OpenVolume
from octobrick.server.views.view import View
from octobrick.store import ingest, open_volume

URL = "/v1/volumes/head/select"
NEAR = {"width": 4000, "height": 4000}


def asked(client: Any, **body: Any) -> dict[str, Any]:
    reply = client.post(URL, json=NEAR | body)
    assert reply.status_code == 200, reply.text
    assert reply.headers["cache-control"] == "no-store"
    assert reply.headers["server-timing"].startswith("select;dur=")
    fields: dict[str, Any] = reply.json()
    return fields


def test_the_answer_is_that_of_the_renderer(client: Any, revision: str, data_dir: Path) -> None:
    volume = open_volume(data_dir / "head.zarr")
    view = View(size=(4000, 4000), azimuth=45.0)
    found = view.select(volume, 512 << 20)
    function = TransferFunction.preset("ct-bone")
    assert found.counts == select(volume, view.camera(volume), view.size, function).counts
    fields = asked(client, azimuth=45)
    assert (fields["revision"], fields["level"], fields["t"]) == (revision, 0, 0)
    assert [brick[3:] for brick in fields["bricks"]] == found.bricks_zyx.tolist()
    assert {tuple(brick[:3]) for brick in fields["bricks"]} == {(0, 0, 0)}
    assert fields["counts"] == found.counts | {"cut": 0}
    stored = [volume.stored_brick(0, (z, y, x)) or b"" for *_, z, y, x in fields["bricks"]]
    assert fields["nbytes"] == [len(frame) for frame in stored]
    assert fields["total_nbytes"] == sum(fields["nbytes"]) > 0
    assert fields["fidelity"]["max_error"] == found.max_error > 0
    assert len(fields["priorities"]) == len(fields["bricks"])
    assert min(fields["priorities"]) > 0
    assert fields["gradients"] == []


def test_a_query_and_a_body_of_the_same_words_get_the_same(client: Any) -> None:
    words = {"azimuth": 200, "preset": "mr", "budget_nbytes": 4000, "width": 64, "height": 32}
    assert client.get(URL, params=words).json() == client.post(URL, json=words).json()


def test_what_the_client_has_is_left_out_and_counted(client: Any) -> None:
    every = asked(client)
    have = [*every["bricks"][::2], [1, 0, 0, 0, 0, 0]]
    rest = asked(client, have=have)
    assert rest["bricks"] == every["bricks"][1::2]
    assert rest["nbytes"] == every["nbytes"][1::2]
    assert rest["counts"]["had"] == len(every["bricks"][::2])


def test_a_smaller_budget_gives_a_coarser_level(client: Any) -> None:
    fields = asked(client, budget_nbytes=1)
    assert (fields["level"], fields["finest_level_wanted"]) == (2, 0)


def test_an_answer_that_would_be_too_long_is_cut_at_the_end_and_says_so(
    make_client: Any, client: Any, data_dir: Path
) -> None:
    every = asked(client)
    settings = Settings(data_dir=data_dir, max_selected_bricks=3)
    with make_client(create_app(settings)) as bounded:
        some = asked(bounded)
    assert some["bricks"] == every["bricks"][:3]
    assert some["counts"]["cut"] == len(every["bricks"]) - 3
    assert some["counts"]["needed"] == every["counts"]["needed"]
    assert some["total_nbytes"] == sum(every["nbytes"][:3])


def test_a_get_with_a_revision_is_kept_for_ever_and_one_without_asks_again(
    client: Any, revision: str, replace_volume: Callable[[str], None]
) -> None:
    words = {"azimuth": 10, "width": 64}
    fixed = client.get(URL, params=words | {"revision": revision})
    assert "immutable" in fixed.headers["cache-control"]
    free = client.get(URL, params=words)
    assert free.headers["cache-control"] == "no-cache"
    etag = free.headers["etag"]
    again = client.get(URL, params=words, headers={"if-none-match": etag})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", etag)
    other = client.get(URL, params=words | {"azimuth": 11}, headers={"if-none-match": etag})
    assert other.status_code == 200
    replace_volume("head")
    assert client.get(URL, params=words, headers={"if-none-match": etag}).status_code == 200
    gone = client.get(URL, params=words | {"revision": revision}, headers={"if-none-match": etag})
    assert gone.status_code == 410


@pytest.fixture
def two(data_dir: Path) -> Path:
    """A volume of two channels with stored gradients."""
    voxels = np.random.default_rng(1).integers(0, 4000, (2, 32, 32, 48)).astype(np.uint16)
    np.save(data_dir / "two.npy", voxels)
    path = data_dir / "two.zarr"
    options: Any = {"brick": 16, "workers": 1, "gradients": True, "axes": "czyx"}
    ingest(data_dir / "two.npy", path, codec=S3dc(), **options)
    return path


def test_bricks_of_directions_are_listed_where_the_light_comes_from_them(
    client: Any, two: Path
) -> None:
    def asked(**body: Any) -> dict[str, Any]:
        fields: dict[str, Any] = client.post(
            f"/v1/volumes/{two.stem}/select", json={"level": 1, "c": 1, **body}
        ).json()
        return fields

    lit = asked()
    assert lit["gradients"] == lit["bricks"] != []
    assert {brick[2] for brick in lit["bricks"]} == {1}
    rest = asked(have_gradients=lit["bricks"][:1])
    assert (rest["gradients"], rest["bricks"]) == (lit["bricks"][1:], lit["bricks"])
    assert asked(shading=False)["gradients"] == []


def test_a_brick_of_several_channels_is_listed_for_each_in_a_row(
    two: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SelectBody, "to_view", lambda _: View(c=(1, 0), level=1))
    volume = open_volume(two)
    body = SelectBody(have=[(1, 0, 1, 0, 0, 0)])
    fields = json.loads(answer(OpenVolume(volume, None, two), "two", body, 100))
    found = [(c, tuple(zyx)) for _, _, c, *zyx in fields["bricks"]]
    assert found == [(1, (0, 0, 1)), (0, (0, 0, 1)), (0, (0, 0, 0))]
    sizes = [len(volume.stored_brick(1, zyx, 0, c) or b"") for c, zyx in found]
    assert fields["nbytes"] == sizes
    assert (fields["channels"], fields["counts"]["had"]) == ([1, 0], 1)


@pytest.mark.parametrize(
    "body",
    [{"level": 9}, {"t": 3}, {"width": 0}, {"width": 10**9}, {"budget_nbytes": 0},
     {"budget_nbytes": 10**30}, {"have": [[1, 2, 3]]}, {"have": [[0, 0, 0, 0, 0, -1]]},
     {"camera": {"eye_world_xyz": [1e300, 0, 0], "target_world_xyz": [0, 0, 0],
                 "fov_degrees": 30}},
     {"distance": 1e200}, {"nonsense": 1}],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(
    client: Any, error_of: Callable[[Any], dict[str, Any]], body: dict[str, Any]
) -> None:
    reply = client.post(URL, json=body)
    assert (reply.status_code, error_of(reply)["kind"]) == (422, "invalid-input")
