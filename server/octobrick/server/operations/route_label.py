"""The few words by which logs and metrics tell requests apart: never an id, never a path."""

from __future__ import annotations

import re

from starlette.types import Scope

_BELOW_VOLUME = re.compile(
    r"/v1/volumes/[^/]+/[^/]+/(bricks|gradients|attributes|tables)(?:/|$)|"
    r"/v1/volumes/[^/]+/(select|bricks|render)"
)
_OWN = frozenset({"/healthz", "/readyz", "/metrics", "/docs", "/openapi.json"})
_METHODS = frozenset({"GET", "HEAD", "POST", "OPTIONS"})
BRICKS, GRADIENTS = "bricks", "gradients"


def route_label(path: str) -> str:
    """Which kind of address a path is, whether it exists or not.

    ``bricks`` is one brick; ``batch`` is many in one body.
    """
    match = _BELOW_VOLUME.match(path)
    if match is not None:
        below_revision, below_volume = match.groups()
        return below_revision or ("batch" if below_volume == "bricks" else below_volume)
    if path in _OWN:
        return path[1:]
    if path == "/v1/volumes":
        return "volumes"
    if path.startswith("/v1/volumes/"):
        return "volume"
    if path.startswith(("/zarr/", "/zarr2/")):
        return "zarr"
    if path.startswith("/precomputed/"):
        return "precomputed"
    return "none"


def method_label(scope: Scope) -> str:
    """The request's method; what no route takes is one label, as clients invent methods."""
    method: str = scope["method"]
    return method if method in _METHODS else "other"
