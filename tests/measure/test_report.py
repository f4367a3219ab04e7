"""The page about a measurement: complete, self-contained, escaped, below 5 MB, the same again."""

from __future__ import annotations

import dataclasses
import io
import re
from functools import cache
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from PIL import Image

from octobrick.codec import S3dc
from octobrick.codec.metrics import Histogram
from octobrick.measure.measurement import (
    CodeRow,
    LevelRow,
    Measurement,
    PictureRow,
    Recommendation,
    Setting,
)
from octobrick.measure.pictures.difference_picture import difference_png
from octobrick.measure.pictures.paths import DEBLOCKED, DIRECT, LEVELS, SLAB, coarser_paths
from octobrick.measure.report import REPORT_NBYTES_MAX, report_html
from octobrick.measure.report.theme import styles_of

EVIL = "<script>alert(1)</script><img src=x onerror=alert(2)>$x_{1}$"


def setting(bits: int | None) -> Setting:
    if bits is None:
        return Setting("lossless", "lossless", None, ("--codec", "lossless"))
    codec = S3dc((8, 8, 8), bits)
    return Setting(f"S3Dc {bits} bits, 8³", "S3Dc, fixed, 8³", codec, ("--bits", str(bits)))


def code_row(bits: int | None) -> CodeRow:
    exact = bits is None
    lost = 0.0 if bits is None else 100 / 2**bits
    errors = np.array([7, 1, 0, 2], np.uint64)
    return CodeRow(
        setting=setting(bits),
        resident_bits=float(bits or 8),
        disk_bits=(bits or 7) * 0.71,
        psnr_db=None if bits is None else 20.125 + 6 * bits,
        ssim=1.0 if exact else 0.9,
        max_error=lost,
        rmse=lost / 3,
        errors=Histogram(0, 0, errors[:1] if exact else errors),
        encode_voxels_per_second=1.5e8,
        decode_voxels_per_second=9e8,
    )


@cache
def png(nbytes: int = 0) -> bytes:
    """Pixels that do not compress, of about so many bytes, or some."""
    side = max(8, round((nbytes / 3) ** 0.5))
    pixels = np.random.default_rng(0).integers(0, 256, (side, side, 3), np.uint8)
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


def picture_row(bits: int | None, path: str = "slab", keys: tuple[str, ...] = ()) -> PictureRow:
    psnr = None if bits is None and path == "slab" else 33.25
    return PictureRow(
        setting=setting(bits),
        path=path,
        render_flags=("--preset", "ct-bone", "--level", "0"),
        frame_seconds=0.0123,
        frame_seconds_quartiles=(0.011, 0.0145),
        psnr_db=psnr,
        ssim=0.98,
        psnr_db_by_view=(psnr, psnr),
        differences=keys,
    )


def measurement(image_nbytes: int = 0, **other: Any) -> Measurement:
    keys = {bits: tuple(f"{bits}-slab-view-{v}-difference" for v in (0, 1)) for bits in (2, 4)}
    images = {f"view-{v}": png(image_nbytes) for v in (0, 1)}
    errors = np.array([[0, 0, 5, 14], [30, 30, 200, 255]], np.uint8)
    for bits in (2, 4):
        images[f"{bits}-slab-view-0"] = png(image_nbytes)
        for key in keys[bits]:
            images[key] = png(image_nbytes) if image_nbytes else difference_png(errors)
    fields: dict[str, Any] = {
        "source": {"name": "head.nrrd", "shape_zyx": [64, 128, 256], "range_of": "all voxels"},
        "options": {"seed": 7, "full": False},
        "sample": {"bricks": 24, "strata": [{"name": "air", "bricks": 3}]},
        "machine": {"processors": 2, "gl_renderer": "llvmpipe"},
        "codes": tuple(code_row(bits) for bits in (None, 1, 2, 4)),
        "levels": (LevelRow(1, 37.5, 41.0, 2.5), LevelRow(2, 31.25, 77.0, 6.5)),
        "pictures": (
            picture_row(None),
            picture_row(4, "slab", keys[4]),
            picture_row(2, "slab", keys[2]),
            picture_row(4, "direct, nearest"),
            picture_row(None, "level 1, stored gradients"),
        ),
        "front": ("lossless", "S3Dc 4 bits, 8³"),
        "recommendations": (
            Recommendation(
                "psnr=44", True, setting(4), "It has 44.1 dB at 2.84 bits.",
                "octobrick ingest head.nrrd head.zarr --bits 4",
            ),
            Recommendation(
                "fps=60", False, setting(2), "The fastest.", "octobrick ingest x",
                "octobrick render head.zarr -o p.png",
            ),
        ),
        "skipped": ("pictures of zerobit by slab: time was over",),
        "elapsed_seconds": 93.7,
        "images": images,
    }  # fmt: skip
    return Measurement(**(fields | other))


class Page(HTMLParser):
    """What of a page would be asked for, run, or read."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.handlers: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.unlabelled: list[str] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        given = {name: value or "" for name, value in attrs}
        names = ("src", "href", "xlink:href", "action", "data", "poster", "srcset")
        self.addresses += [given[name] for name in names if name in given]
        self.handlers += [name for name in given if name.startswith("on")]
        self.ids += [given["id"]] if "id" in given else []
        if given.get("role") == "img" and not given.get("aria-label"):
            self.unlabelled.append(tag)
        if tag == "th" and "scope" not in given:
            self.unlabelled.append(tag)

    def handle_data(self, data: str) -> None:
        self.words += data


@pytest.fixture(scope="module")
def text() -> str:
    return report_html(measurement())


def test_a_page_asks_for_nothing_outside(text: str) -> None:
    page = Page(text)
    assert all(at.startswith(("#", "data:image/png;base64,")) for at in page.addresses)
    assert {"link", "iframe", "object", "embed", "base"}.isdisjoint(page.tags)
    assert "@import" not in text
    assert all(at.startswith("#") for at in re.findall(r"url\(([^)]*)", text))
    assert "default-src 'none'" in text


def test_every_reference_inside_leads_somewhere_and_no_id_comes_twice(text: str) -> None:
    page = Page(text)
    assert len(page.ids) == len(set(page.ids))
    inside = {at[1:] for at in page.addresses if at.startswith("#")}
    inside |= set(re.findall(r"url\(#([^)]+)\)", text))
    assert inside <= set(page.ids)


def test_every_row_target_and_omission_is_told(text: str) -> None:
    words = Page(text).words
    m = measurement()
    for row in m.codes:
        assert row.setting.label in words
        assert " ".join(row.setting.flags) in words
    for row in m.codes[1:]:
        assert f"{row.psnr_db:.2f}" in words
    for picture in m.pictures:
        assert picture.path in words
    for one in m.recommendations:
        assert all(part in words for part in (one.target, one.reason, one.ingest_command))
    assert "octobrick render head.zarr -o p.png" in words
    assert m.skipped[0] in words
    for fact in ("64×128×256", "all voxels", "llvmpipe", "37.50", "31.25", "air"):
        assert fact in words
    assert "12.3" in words  # milliseconds


def test_difference_pictures_say_how_many_pixels_have_each_colour(text: str) -> None:
    shares = "equal: 25.0 %, under 5 %: 12.5 %, 5–10 %: 12.5 %, 10–15 %: 25.0 %, over 15 %: 25.0 %"
    assert shares in Page(text).words.replace("\u00a0", " ")


def test_pictures_plots_and_heads_of_tables_are_labelled(text: str) -> None:
    assert Page(text).unlabelled == []
    assert text.count('class="plot"') == 7
    assert 'lang="en"' in text


def test_text_from_outside_stays_text() -> None:
    evil = dataclasses.replace(setting(4), label=EVIL, family=EVIL, flags=(EVIL,))
    code = dataclasses.replace(code_row(4), setting=evil)
    picture = dataclasses.replace(picture_row(4), setting=evil, path=EVIL, render_flags=(EVIL,))
    advice = Recommendation(EVIL, True, evil, EVIL, EVIL, EVIL)
    text = report_html(
        measurement(
            source={"name": EVIL, EVIL: EVIL}, options={EVIL: [{EVIL: EVIL}]}, sample={EVIL: EVIL},
            machine={EVIL: {EVIL: EVIL}}, codes=(code, code_row(2)), pictures=(picture,),
            front=(EVIL,), recommendations=(advice,), skipped=(EVIL,),
        )
    )  # fmt: skip
    page = Page(text)
    assert page.tags.count("script") == 1  # the page's own
    assert page.handlers == []
    assert "img" not in page.tags
    assert page.words.count(EVIL) >= 10
    assert re.search(r"script-src 'sha256-[\w+/=]+'", text)


def test_equal_measurements_give_equal_pages(text: str) -> None:
    assert report_html(measurement()) == text


@pytest.mark.parametrize("nbytes", [700_000, 6_000_000])
def test_a_page_stays_below_its_limit_and_says_what_it_left_out(nbytes: int) -> None:
    text = report_html(measurement(nbytes))
    assert len(text.encode()) <= REPORT_NBYTES_MAX
    left = re.search(r"(\d+) pictures, to keep this page below 5 MB", Page(text).words)
    assert left is not None
    assert int(left[1]) + text.count("data:image/png") == len(measurement().images)
    if nbytes < 1_000_000:
        assert 'id="view-0"' in text  # the reference is the last to go


def test_a_measurement_of_nothing_but_one_exact_code_is_a_page_too() -> None:
    text = report_html(
        measurement(codes=(code_row(None),), levels=(), pictures=(), front=(), images={},
                    recommendations=(), skipped=())
    )  # fmt: skip
    words = Page(text).words
    assert "lossless" in words
    assert "No target was asked" in words


def test_what_cannot_be_told_is_a_dash() -> None:
    rows = (dataclasses.replace(code_row(2), ssim=float("nan")), code_row(None))
    assert "–" in Page(report_html(measurement(codes=rows))).words


def test_every_way_to_draw_has_a_mark_of_its_own() -> None:
    paths = (SLAB, DEBLOCKED, *DIRECT, *coarser_paths(LEVELS))
    marks = [style.marker for style in styles_of(path.name for path in paths).values()]
    assert len(set(marks)) == len(paths)


def test_a_colour_that_returns_has_another_mark() -> None:
    styles = list(styles_of(map(str, range(24))).values())
    assert len({(style.color, style.marker) for style in styles}) == len(styles)
