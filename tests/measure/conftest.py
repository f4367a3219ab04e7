from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.measure import PictureRow, Setting

Voxels = NDArray[Any]


def mostly_air(shape: tuple[int, int, int], dtype: str = "uint8", seed: int = 0) -> Voxels:
    """Zeros, but for a ball of structure and noise in one corner."""
    rng = np.random.default_rng(seed)
    grid = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    near = sum((axis - 30.0) ** 2 for axis in grid) < 26**2
    wave = np.sin(grid[0] / 5.0) * np.cos(grid[2] / 7.0) + 0.1 * rng.standard_normal(shape)
    values = np.where(near, 120 + 60 * wave, 0)
    return values.astype(dtype)


@pytest.fixture
def saved(tmp_path: Path) -> Callable[..., Path]:
    """Write an array as .npy."""

    def save(voxels: Voxels, name: str = "volume") -> Path:
        np.save(tmp_path / f"{name}.npy", voxels)
        return tmp_path / f"{name}.npy"

    return save


@dataclass
class StandInPictures:
    """In the place of the renderer: takes note of what it was to draw."""

    seconds: float = 0.05
    seen: list[dict[str, Any]] = field(default_factory=list)
    rows: tuple[PictureRow, ...] = ()
    images: dict[str, bytes] = field(default_factory=dict)
    skipped: tuple[str, ...] = ("pictures: one",)
    gl_renderer: str = "stand-in"

    def __call__(
        self,
        part: Voxels,
        spacing_xyz: tuple[float, float, float],
        window: tuple[float, float],
        settings: Sequence[Setting],
        options: Any,
        folder: Path,
        deadline: Callable[[], bool],
        report: Callable[[str, float], None],
    ) -> StandInPictures:
        assert folder.is_dir()
        self.seen.append({"part": part, "window": window, "settings": settings, "late": deadline()})
        self.rows = tuple(
            PictureRow(
                setting=setting,
                path="slab",
                render_flags=("--no-deblock",),
                frame_seconds=self.seconds * (1 + rank),
                frame_seconds_quartiles=(self.seconds, self.seconds),
                psnr_db=None if rank == 0 else 50.0 - rank,
                ssim=1.0,
                psnr_db_by_view=(None,),
            )
            for rank, setting in enumerate(settings)
        )
        self.images = {"view-0": b"png"}
        return self
