"""A picture's file says by its suffix what is in it, and appears whole or not at all."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.renderer import picture_files

from .pictures import ramp


@pytest.mark.parametrize("name", ["a.png", "a.PNG", "a.webp"])
@pytest.mark.parametrize("background", [None, (0, 0, 0)])
def test_png_and_webp_lose_nothing(tmp_path: Path, name: str, background: Any) -> None:
    image = ramp(background=background)
    image.save(tmp_path / name)
    read = np.asarray(Image.open(tmp_path / name))
    np.testing.assert_array_equal(read, image.rgba[..., : read.shape[2]])
    assert read.shape[2] == (4 if background is None else 3)


def test_jpeg_and_webp_have_a_quality(tmp_path: Path) -> None:
    image = ramp((200, 120))
    for suffix in (".jpg", ".jpeg", ".webp"):
        nbytes, errors = [], []
        for quality in (10, 95):
            file = tmp_path / f"{quality}{suffix}"
            image.save(file, quality=quality)
            read = np.asarray(Image.open(file)).astype(float)
            nbytes.append(file.stat().st_size)
            errors.append(np.abs(read - image.rgba[..., :3]).mean())
        assert nbytes[0] < nbytes[1]
        assert errors[1] < min(errors[0], 2.0)


def test_exr_holds_what_rays_gathered_and_where_they_stopped(tmp_path: Path) -> None:
    exr = pytest.importorskip("OpenEXR")
    depth = np.full((24, 40), np.inf, np.float32)
    depth[3:9] = 12.5
    image = replace(ramp(), depth=depth)
    image.save(tmp_path / "a.exr")
    channels = exr.File(str(tmp_path / "a.exr")).channels()
    np.testing.assert_array_equal(channels["RGBA"].pixels, image.premultiplied)
    np.testing.assert_array_equal(channels["Z"].pixels, depth)
    ramp().save(tmp_path / "b.exr")
    assert set(exr.File(str(tmp_path / "b.exr")).channels()) == {"RGBA"}


def test_npy_holds_what_rays_gathered(tmp_path: Path) -> None:
    ramp().save(tmp_path / "a.npy")
    read = np.load(tmp_path / "a.npy")
    assert read.dtype == np.float32
    np.testing.assert_array_equal(read, ramp().premultiplied)


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("a.bmp", {}, r"\.png, \.webp, \.jpg, \.jpeg, \.exr, \.npy"),
        ("a", {}, r"\.png, \.webp"),
        ("a.png", {"quality": 90}, r"choose one of \.webp, \.jpg"),
        ("a.jpg", {"quality": 0}, "1 to 100"),
        ("a.webp", {"quality": 101}, "1 to 100"),
    ],
)
def test_what_cannot_be_written_is_refused(
    tmp_path: Path, name: str, options: Any, says: str
) -> None:
    with pytest.raises(InvalidInputError, match=says):
        ramp().save(tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_a_transparent_picture_is_no_jpeg(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="background"):
        ramp(background=None).save(tmp_path / "a.jpg")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "module", "extra"), [("a.exr", "OpenEXR", "exr"), ("a.webp", "PIL.Image", "render")]
)
def test_a_missing_package_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, module: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ResourceError, match=rf"octobrick\[{extra}\]"):
        picture_files.require_picture(tmp_path / name)
    with pytest.raises(ResourceError, match=rf"octobrick\[{extra}\]"):
        ramp().save(tmp_path / name)


def test_a_failed_write_leaves_the_old_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "a.png"
    file.write_bytes(b"old")

    def fail(path: Path, content: bytes) -> int:
        with path.open("wb") as half:
            half.write(content[:10])
        raise OSError(5, "disk gone")

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(OSError, match="disk gone"):
        ramp().save(file)
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "link.png").symlink_to(tmp_path / "real.png")
    ramp().save(tmp_path / "link.png")
    assert (tmp_path / "link.png").is_symlink()
    assert (tmp_path / "real.png").read_bytes() == ramp().png()
