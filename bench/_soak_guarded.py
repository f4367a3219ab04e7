"""A second server that wants tokens, in a soak: with one, without, and by signed addresses."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from _clients import Client

from octobrick.server.security.signed_paths import signed_prefix
from octobrick.server.security.tokens import new_secret, token_entry

if TYPE_CHECKING:
    from _soak_run import Soak

V1 = "/v1/volumes"
SIGNED_SECONDS = 3600


class Guarded:
    """Secrets of a server, made anew for each soak."""

    def __init__(self, folder: Path) -> None:
        self.key, self.secret, self.port = new_secret(), new_secret(), 0
        self.tokens_file = folder / "tokens.json"
        entry = token_entry("soak", self.secret, ("steady",), None)
        self.tokens_file.write_text(json.dumps([entry]))

    @contextmanager
    def settings(self) -> Iterator[None]:
        """While it lasts, servers that are started are guarded, small ones."""
        added = {
            "OCTOBRICK_TOKENS_FILE": str(self.tokens_file),
            "OCTOBRICK_SIGNING_KEY": self.key,
            "OCTOBRICK_WORKERS": "1",
            "OCTOBRICK_RENDER_WORKERS": "0",
        }
        before = dict(os.environ)
        os.environ.update(added)
        try:
            yield
        finally:
            os.environ.clear()
            os.environ.update(before)


def ask_guarded(soak: Soak, _client: Client, _volume_id: str, _chance: np.random.Generator) -> None:
    """Metadata and a brick: refused without a token, given with one or by a signature."""
    client = Client("127.0.0.1", soak.guarded.port)
    path, now = f"{V1}/steady", int(time.time())
    key = soak.guarded.key.encode()
    bare = client.ask("GET", path)
    if (bare.status, bare.kind()) != (401, "unauthorized"):
        soak.is_wrong(f"without a token: {bare.status} {bare.body[:200]!r}")
    late = client.ask("GET", signed_prefix(key, "steady", now - 1) + path)
    other = client.ask("GET", signed_prefix(key, "steady", now + 9) + f"{V1}/damaged")
    for refused in (late, other):
        if (refused.status, refused.kind()) != (403, "forbidden"):
            soak.is_wrong(f"a signature that is not good: {refused.status}")
    signed = signed_prefix(key, "steady", now + SIGNED_SECONDS)
    bearer = {"authorization": f"Bearer {soak.guarded.secret}"}
    revision = client.ask("GET", path, **bearer).json()["revision"]
    brick = f"{path}/{revision}/bricks/0/0/0/1/1/1"
    pinned = f"/zarr/steady@{revision}/zarr.json"
    for address in (path, brick, pinned):
        own = client.ask("GET", address, accept_encoding="zstd", **bearer)
        shared = client.ask("GET", signed + address, accept_encoding="zstd")
        if (own.status, shared.status) != (200, 200):
            soak.is_wrong(f"{address}: {own.status} with a token, {shared.status} signed")
        elif address == brick and not (
            own.body == shared.body == soak.truth.stored(revision, (0, 0, 0, 1, 1, 1))
        ):
            soak.is_wrong(f"WRONG BYTES: {address}, with a token or signed")
    client.close()
    soak.count("token and signature", verified=2)
