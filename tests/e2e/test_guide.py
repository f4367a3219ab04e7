"""The code of docs/guide-rendering.md runs, and makes the pictures that the page shows."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octobrick.store import ingest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def maker() -> Any:
    spec = importlib.util.spec_from_file_location("maker", DOCS / "make_guide_pictures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.gl
def test_the_guide_runs_and_makes_its_pictures(maker: Any, tmp_path: Path) -> None:
    """On a ball instead of the head, which takes a tenth of the time."""
    z, y, x = np.ogrid[-16:16, -16:16, -16:16]
    ball = np.clip(200 - 10 * np.sqrt(z * z + y * y + x * x), 0, None).astype(np.uint8)
    np.save(tmp_path / "ball.npy", ball)
    ingest(tmp_path / "ball.npy", tmp_path / "head.zarr", brick=8, workers=1)
    maker.run_page(tmp_path)
    made = {file.name for file in tmp_path.glob("*.*")}
    assert maker.pictures_of(maker.PAGE) <= made
    assert {"cutout.npy", "turn.gif"} <= made


def test_every_picture_of_the_guide_is_there_and_small(maker: Any) -> None:
    files = [DOCS / "images" / name for name in maker.pictures_of(maker.PAGE)]
    assert len(files) == 7
    assert sum(file.stat().st_size for file in files) < 600_000
