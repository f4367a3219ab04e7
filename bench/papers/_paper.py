"""What the papers' figures share: claims beside ours, plots, rows of pictures, the command line."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import _measure
import numpy as np
from numpy.typing import NDArray
from PIL import Image

OUT = _measure.OUT / "papers"
GAP = 4  # pixels between pictures
Rgb = NDArray[np.uint8]


class Claim(NamedTuple):
    """A published number beside ours.

    Args:
        what: is counted, with its unit.
        published: as printed; None where the paper gives none.
        ours: measured just now.
    """

    what: str
    published: float | None
    ours: float


def claims_text(head: str, claims: Iterable[Claim], digits: int = 4) -> str:
    """Lines of published, ours, and how much ours is above."""
    rows = [
        [
            claim.what,
            "-" if claim.published is None else f"{claim.published:g}",
            f"{claim.ours:.{digits}f}",
            "-" if claim.published is None else f"{claim.ours - claim.published:+.{digits}f}",
        ]
        for claim in claims
    ]
    return _measure.layout([head, "published", "ours", "difference"], rows)


def parser(doc: str | None) -> argparse.ArgumentParser:
    """The options that every figure has."""
    made = _measure.parser(doc)
    made.add_argument("--pictures", type=Path, default=OUT, help="where pictures and plots go")
    return made


@contextmanager
def plots(path: Path, count: int, width_inches: float = 4.6) -> Iterator[Any]:
    """Axes beside each other, written as path.svg and path.png afterwards.

    Args:
        path: without suffix.
        count: of axes.
        width_inches: of one.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    size = (width_inches * count, 3.4)
    figure, axes = plt.subplots(1, count, figsize=size, layout="constrained", squeeze=False)
    try:
        yield axes[0]
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path.with_suffix(".svg"))
        figure.savefig(path.with_suffix(".png"), dpi=110)
    finally:
        plt.close(figure)


def mosaic(rows: Sequence[Sequence[Rgb]]) -> Rgb:
    """Pictures of one size in rows, a white gap between them."""
    lines = [_joined(row, 1) for row in rows]
    return _joined(lines, 0)


def _joined(pictures: Sequence[Rgb], axis: int) -> Rgb:
    shape = list(pictures[0].shape)
    shape[axis] = GAP
    gap = np.full(shape, 255, np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)][1:]
    return np.concatenate(parts, axis=axis)


def save(picture: Rgb, path: Path) -> None:
    """As PNG, and as WebP, which is what documents show."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.fromarray(picture)
    image.save(path.with_suffix(".png"))
    image.save(path.with_suffix(".webp"), quality=86, method=6)
