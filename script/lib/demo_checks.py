"""What the demo proves: that the bricks and pictures which it gets are the ones they should be."""

from __future__ import annotations

import json
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from octobrick.codec.errors import CorruptDataError, NotFoundError
from octobrick.store import Volume, brick_codec, open_volume
from octobrick.store.box import Box, Zyx, cell_box
from octobrick.store.sources import Source, open_source

FETCH_LIMIT_SECONDS = 120.0  # a picture on a slow software renderer takes a while
BRICKS_FETCHED = 24  # spread evenly over all levels: whole ones, border ones, coarse ones
CONTRAST = 32  # of 255 grey levels: less between darkest and brightest is no picture


class CheckError(Exception):
    """What came back is not what must come back; the message says what and where."""


@dataclass(frozen=True)
class Address:
    """Where a brick is in a volume of one time step and channel."""

    level: int
    brick_zyx: Zyx

    def __str__(self) -> str:
        return f"{self.level}/0/0/" + "/".join(map(str, self.brick_zyx))


def is_good(path: Path) -> bool:
    """Whether a volume is there and every one of its bricks has the checksum it was stored with."""
    try:
        with open_volume(path) as volume:
            for address in addresses(volume):
                volume.brick_code(address.level, address.brick_zyx)
    except (NotFoundError, CorruptDataError):
        return False
    return True


def addresses(volume: Volume) -> Iterator[Address]:
    """Every brick of a volume's first time step and channel, finest level first."""
    for level in volume.levels:
        for zyx in np.ndindex(*level.grid_zyx):
            z, y, x = zyx
            yield Address(level.index, (z, y, x))


def check_bricks(url: str, name: str, path: Path, source: Path) -> str:
    """Fetch bricks as a client would, and hold them to the local volume and to the source.

    Returns:
        A sentence that says what was compared, and the worst error that was met.

    Raises:
        CheckError: the server lists, describes or sends something else than the volume has.
    """
    listed = [entry["id"] for entry in _get_json(f"{url}/v1/volumes")["volumes"]]
    _require(name in listed, f"{url}/v1/volumes lists {listed}, without {name}")
    with open_volume(path) as volume, open_source(source) as original:
        described = _get_json(f"{url}/v1/volumes/{name}")
        _require(
            described["revision"] == volume.revision,
            f"the server has revision {described['revision']}, the folder {volume.revision}",
        )
        everything = list(addresses(volume))
        chosen = everything[:: max(1, len(everything) // BRICKS_FETCHED)]
        worst, nbytes = 0.0, 0
        for address in chosen:
            place = f"{url}/v1/volumes/{name}/{volume.revision}/bricks/{address}"
            voxels = _fetch_brick(place, volume, address)
            nbytes += len(volume.stored_brick(address.level, address.brick_zyx) or b"")
            if address.level == 0:
                worst = max(worst, _error_to_source(voxels, address, volume, original))
        allowed = volume.level(0).max_error
        _require(worst <= allowed, f"a voxel is off by {worst:g}, the volume says {allowed:g}")
    return (
        f"{len(chosen)} of {len(everything)} bricks, {nbytes / 1e3:.0f} kB: the bytes of the "
        f"volume, and voxels of the source to {worst:g} (measured at ingest: {allowed:g})"
    )


def _fetch_brick(place: str, volume: Volume, address: Address) -> NDArray[Any]:
    """One brick, both as the code itself and as the zstd frame that is on disk."""
    local = volume.brick(address.level, address.brick_zyx)
    code = volume.brick_code(address.level, address.brick_zyx)
    if code is None:
        _require(_get(place) == b"", f"{place} sends bytes for a brick that is absent")
        return local
    frame = volume.stored_brick(address.level, address.brick_zyx)
    _require(_get(place, encoding="zstd") == frame, f"{place}: not the zstd frame that is stored")
    body = _get(place)
    codec = volume.level_codec(address.level)
    voxels = brick_codec.decode(codec, body, local.shape, local.dtype)
    _require(np.array_equal(voxels, local), f"{place}: decodes to other voxels than the volume's")
    return voxels


def _error_to_source(
    voxels: NDArray[Any], address: Address, volume: Volume, source: Source
) -> float:
    """The largest difference between a brick of level 0 and the file that it was made from."""
    box = cell_box(address.brick_zyx, volume.brick_shape_zyx)
    inside = box.intersect(Box.of_shape(source.shape_zyx))
    nz, ny, nx = inside.shape_zyx
    exact = source.read(inside).astype(np.float64)
    return float(np.abs(voxels[:nz, :ny, :nx] - exact).max())


def check_render(url: str, name: str, query: dict[str, str], target: Path, local: Path) -> str:
    """Fetch a picture, keep it at ``target``, and hold it to the one that was rendered here.

    Raises:
        CheckError: there is nothing on it, or it shows something else.
    """
    place = f"{url}/v1/volumes/{name}/render?{urllib.parse.urlencode(query)}"
    target.write_bytes(_get(place))
    check_picture(target)
    with Image.open(target) as fetched, Image.open(local) as rendered:
        _require(
            fetched.size == rendered.size and fetched.mode == rendered.mode,
            f"{place} is {fetched.mode} {fetched.size}, {local} {rendered.mode} {rendered.size}",
        )
        difference = np.abs(np.asarray(fetched, np.int16) - np.asarray(rendered, np.int16)).max()
    _require(difference <= 1, f"{place} and {local} differ by up to {difference} grey levels")
    return f"{target.name}: the same picture as {local.name}, {target.stat().st_size / 1e3:.0f} kB"


def check_picture(path: Path) -> None:
    """Refuse a picture with nothing on it, which is what a broken driver gives.

    Raises:
        CheckError: all of its pixels are about the same.
    """
    with Image.open(path) as picture:
        contrast = np.ptp(np.asarray(picture.convert("L")))
    _require(contrast >= CONTRAST, f"{path} shows nothing: all its pixels are alike")


def _get_json(place: str) -> Any:
    return json.loads(_get(place))


def _get(place: str, encoding: str = "identity") -> bytes:
    request = urllib.request.Request(place, headers={"Accept-Encoding": encoding})
    try:
        with urllib.request.urlopen(request, timeout=FETCH_LIMIT_SECONDS) as reply:
            body: bytes = reply.read()
            return body
    except urllib.error.HTTPError as error:
        raise CheckError(f"{place}: {error.code} {error.read().decode(errors='replace')}") from None


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise CheckError(otherwise)
