from __future__ import annotations

import base64
import io
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Fidelity, RenderedImage, RenderStats
from octobrick.renderer.budget import parse_nbytes
from octobrick.renderer.image import checked_background

PREMULTIPLIED = np.array([[[0.25, 0.5, 0.0, 0.5], [0, 0, 0, 0]]], np.float32)


FINISHED = {
    None: [[[128, 255, 0, 128], [0, 0, 0, 0]]],
    (0, 0, 0): [[[64, 128, 0, 255], [0, 0, 0, 255]]],
}


def picture(background: Any) -> RenderedImage:
    stats = RenderStats(
        0, {"total": 1}, 1, 1, 0, 0, 0, 0, 1.0, 1.0, (0.0, 1.0), {"total": 250.0}, "x"
    )
    rgba = np.array(FINISHED[background], np.uint8)
    return RenderedImage(rgba, PREMULTIPLIED, Fidelity(0, 0, 0.0, True), stats)


def test_png_is_rgb_where_opaque_and_rgba_else() -> None:
    for background, mode in (((0, 0, 0), "RGB"), (None, "RGBA")):
        image = picture(background)
        read = Image.open(io.BytesIO(image.png()))
        assert read.mode == mode
        np.testing.assert_array_equal(np.asarray(read), image.rgba[..., : len(mode)])


def test_it_says_what_is_known_of_it() -> None:
    assert repr(picture(None)) == ("<RenderedImage 2×1, level 0, worst error 0, converged, 0.25 s>")
    coarse = replace(picture(None), fidelity=Fidelity(2, 1, 3.5, False))
    assert "level 2 instead of 1, worst error 3.5, not converged" in repr(coarse)


def test_a_notebook_shows_the_picture_with_what_is_known_of_it() -> None:
    image = picture((0, 0, 0))
    bundle = image._repr_mimebundle_()
    assert set(bundle) == {"text/plain", "text/html"}
    assert "<figcaption" in bundle["text/html"]
    assert "2×1, level 0, worst error 0, converged" in bundle["text/html"]
    data = bundle["text/html"].split("base64,")[1].split('"')[0]
    assert base64.b64decode(data) == image.png()
    assert set(image._repr_mimebundle_(include=["image/png"])) == {"image/png"}
    assert set(image._repr_mimebundle_(exclude=["text/html"])) == {"text/plain"}


def test_fidelity_and_stats_are_json_ready() -> None:
    image = picture(None)
    assert json.loads(json.dumps(image.fidelity.to_dict()))["converged"] is True
    assert json.loads(json.dumps(image.stats.to_dict()))["window"] == [0.0, 1.0]


@pytest.mark.parametrize("background", [(0, 0), (0, 0, 2), (0, 0, -0.1), "red", 3, (0, 0, None)])
def test_impossible_backgrounds_are_refused(background: Any) -> None:
    with pytest.raises(InvalidInputError, match="background"):
        checked_background(background)


@pytest.mark.parametrize(
    ("size", "nbytes"),
    [(1, 1), ("1", 1), ("512MiB", 512 << 20), ("1.5 GB", 1_500_000_000), (" 2kib ", 2048)],
)
def test_sizes_are_read_with_their_unit(size: Any, nbytes: int) -> None:
    assert parse_nbytes(size) == nbytes


@pytest.mark.parametrize("size", [0, -1, "", "MiB", "1 XB", "-1MB", 1.5, None, True, "1e9", "0"])
def test_what_is_no_size_is_refused(size: Any) -> None:
    with pytest.raises(InvalidInputError, match="size"):
        parse_nbytes(size)
