"""A progressive picture in a browser: an ordinary `<img>` shows the coarse, then the final one."""

from __future__ import annotations

import base64
import http.client
import io
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlencode

import numpy as np
import pytest
from PIL import Image

from octobrick.store import ingest

CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")
WAIT_SECONDS = 60  # only a failing test waits as long
# Fine steps, so that the final picture takes long enough for a browser to show the coarse one.
QUESTION = {"width": 320, "height": 240, "preset": "microscopy", "step_voxels": 0.1}
TARGET = f"/v1/volumes/ball/render?{urlencode(QUESTION)}&progressive=true"
WATCH = """
([target, milliseconds]) => new Promise(done => {
  const image = new Image(), canvas = document.createElement("canvas"), shown = [];
  const end = performance.now() + milliseconds;
  const look = () => {
    if (image.naturalWidth) {
      canvas.width = image.naturalWidth;
      canvas.height = image.naturalHeight;
      canvas.getContext("2d").drawImage(image, 0, 0);
      const now = canvas.toDataURL("image/png");
      if (now !== shown.at(-1)) shown.push(now);
    }
    if (shown.length < 2 && performance.now() < end) requestAnimationFrame(look);
    else done(shown);
  };
  document.body.replaceChildren(image);
  image.src = target;
  look();
})
"""

pytestmark = [
    pytest.mark.gl,
    pytest.mark.skipif(not Path(CHROMIUM).exists(), reason=f"there is no {CHROMIUM}"),
]


@pytest.fixture
def port(tmp_path: Path) -> Iterator[int]:
    """Of a server with one volume."""
    z, y, x = np.ogrid[-40:40, -40:40, -40:40]
    ball = np.clip(4000 - 3 * (z * z + y * y + x * x) + z + y + x, 0, None).astype(np.uint16)
    np.save(tmp_path / "ball.npy", ball)
    ingest(tmp_path / "ball.npy", tmp_path / "data" / "ball.zarr", brick=32, workers=1)
    with subprocess.Popen(
        [sys.executable, "-m", "octobrick.server.cli", "serve", tmp_path / "data", "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout
        try:
            yield int(process.stdout.readline().rsplit(":", 1)[1])
        finally:
            process.terminate()


def parts_of(port: int) -> list[np.ndarray]:
    """The pictures of the answer, as any client gets them."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=WAIT_SECONDS)
    connection.request("GET", TARGET, headers={"Accept": "image/png"})
    reply = connection.getresponse()
    boundary = reply.headers["content-type"].rsplit("boundary=", 1)[1].encode()
    parts = reply.read().split(b"--" + boundary)[1:-1]
    connection.close()
    return [pixels(part.split(b"\r\n\r\n", 1)[1]) for part in parts]


def shown_by_chromium(port: int) -> list[np.ndarray]:
    """The different pictures that an `<img>` shows, in their order."""
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        # An answer of the service forbids all content; it is only the place of a page here.
        page = browser.new_page(bypass_csp=True)
        page.goto(f"http://127.0.0.1:{port}/healthz")  # any page of the same origin
        shown = page.evaluate(WATCH, [TARGET, 1000 * WAIT_SECONDS])
        browser.close()
    return [pixels(base64.b64decode(address.partition(",")[2])) for address in shown]


def pixels(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def test_an_img_element_shows_the_coarse_and_then_the_final_picture(port: int) -> None:
    coarse, *_, final = parts_of(port)
    assert not np.array_equal(coarse, final)
    first, last = shown_by_chromium(port)
    np.testing.assert_array_equal(first, coarse)
    np.testing.assert_array_equal(last, final)
