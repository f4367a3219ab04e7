"""Renderers that live as long as the test run, and volumes whose pictures are known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.renderer import Renderer

DIFFS = Path(__file__).parents[1] / "_diffs"


@pytest.fixture(scope="session")
def renderer() -> Iterator[Renderer]:
    """A machine without EGL fails here, with the message that says what to install."""
    with Renderer("256MiB") as shared:
        yield shared


@pytest.fixture(scope="session")
def unculled() -> Iterator[Renderer]:
    """Samples every brick at every step: the reference for dropping and skipping."""
    with Renderer("256MiB", cull=False) as shared:
        yield shared


@pytest.fixture(scope="session")
def thin() -> Iterator[Renderer]:
    """Cuts small volumes into several slabs."""
    with Renderer("2MiB", slab_budget="256KiB") as shared:
        yield shared


def make_blobs() -> NDArray[np.uint8]:
    """Soft blobs and one hard box in empty space, no axis alike, no size that divides anything."""
    shape = (59, 70, 83)
    z, y, x = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape), indexing="ij")
    field = np.zeros(shape)
    for cz, cy, cx, radius, height in [
        (20, 22, 25, 12, 230),
        (38, 45, 60, 15, 160),
        (45, 15, 70, 7, 255),
        (5, 60, 8, 9, 200),
        (31, 32, 32, 3, 250),
    ]:
        distance = np.sqrt((z - cz) ** 2 + (y - cy) ** 2 + (x - cx) ** 2)
        field = np.maximum(field, height * np.clip(1.5 - distance / radius, 0, 1))
    field[50:, 50:60, 30:50] = 120
    return field.astype(np.uint8)


@pytest.fixture(scope="session")
def blobs() -> NDArray[np.uint8]:
    """See `make_blobs`; the same for all tests, which do not change it."""
    return make_blobs()


@pytest.fixture
def require_alike(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Fail where two 8-bit pictures differ by more than a tolerance, and save what differs."""

    def check(found: NDArray[np.uint8], wanted: NDArray[np.uint8], tolerance: int = 0) -> None:
        difference = np.abs(found.astype(np.int16) - wanted.astype(np.int16))
        if difference.max() <= tolerance:
            return
        from PIL import Image

        DIFFS.mkdir(exist_ok=True)
        name = request.node.name.replace("/", "_")
        shown: list[tuple[str, Any]] = [
            ("found", found),
            ("wanted", wanted),
            ("difference", np.clip(difference * 16, 0, 255).astype(np.uint8)),
        ]
        for what, pixels in shown:
            Image.fromarray(pixels[..., :3]).save(DIFFS / f"{name}.{what}.png")
        pytest.fail(
            f"{int((difference > tolerance).any(axis=-1).sum())} pixels differ by up to "
            f"{difference.max()}, allowed {tolerance}; see {DIFFS / name}.*.png"
        )

    return check
