"""Ways to draw: the flags that a report prints draw what was measured."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from octobrick.codec import S3dc, Zerobit
from octobrick.measure.pictures.paths import DEBLOCKED, DIRECT, SLAB, RenderPath, coarser_paths
from octobrick.renderer import Renderer, TransferFunction
from octobrick.server.cli import main
from octobrick.server.views.view import View
from octobrick.store import ingest, open_volume

PATHS = (SLAB, DEBLOCKED, *DIRECT, *coarser_paths(2))


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("paths")
    z, y, x = np.ogrid[-20:20, -24:24, -16:16]
    ball = np.clip(255 - 9 * np.sqrt(z * z + (y - 5) ** 2 + (x + 3) ** 2), 0, None)
    np.save(folder / "ball.npy", (ball + 5 * np.sin(x * y)).clip(0).astype(np.uint8))
    ingest(
        folder / "ball.npy", folder / "ball.zarr", codec=S3dc((8, 8, 8), 2), gradients=True,
        levels=2, brick=32, workers=1,
    )  # fmt: skip
    return folder / "ball.zarr"


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    with Renderer("64MiB") as shared:
        yield shared


@pytest.mark.gl
@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.name)
def test_the_flags_of_a_path_draw_what_its_arguments_draw(
    path: RenderPath, volume: Path, renderer: Renderer, tmp_path: Path
) -> None:
    arguments = ["render", volume, "-o", tmp_path / "p.png", "--preset", "mr", "--size", "40x32"]
    result = CliRunner().invoke(main, [str(a) for a in (*arguments, *path.flags)])
    assert result.exit_code == 0, result.stderr
    with open_volume(volume) as opened:
        function = TransferFunction.preset("mr")
        camera = View(transfer_function=function).camera(opened)
        image = renderer.render(opened, camera, function, (40, 32), **path.arguments)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "p.png")), image.rgba[..., :3])


def test_direct_paths_are_for_s3dc_at_a_fixed_rate_with_a_linear_scale() -> None:
    for path in DIRECT:
        assert path.applies_to(S3dc((8, 8, 8), 4))
        for codec in (None, Zerobit(0.1), S3dc((4, 4, 4), max_error=2)):
            assert not path.applies_to(codec)
        assert not path.applies_to(S3dc((8, 8, 8), 4, scale="trained"))


def test_what_lost_nothing_is_not_deblocked() -> None:
    assert not DEBLOCKED.applies_to(None)
    assert DEBLOCKED.applies_to(Zerobit(0.1))
    assert SLAB.applies_to(None)
