"""Shows a volume of `octobrick serve` in Neuroglancer, unchanged, and keeps the picture of it.

python docs/make_neuroglancer_picture.py      writes docs/images/neuroglancer.png

Needs `pip install neuroglancer playwright`, and Chromium (its path in CHROMIUM, by default
/usr/bin/chromium). Left the volume as `precomputed://`, right as `zarr3://`.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import neuroglancer
import numpy as np
import tifffile
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from octobrick.store import ingest

DOCS = Path(__file__).parent
VOXELS = DOCS.parent / "data" / "ct_vhf_head.zraw"
SHAPE_ZYX = (234, 512, 512)
SPACING_MM_XYZ = (0.9765625, 0.9765625, 1.0)
WIDTH, HEIGHT = 720, 400
SOURCES = ("precomputed://{url}/precomputed/head", "zarr3://{url}/zarr/head")
# WebGL 2 without a screen: by EGL on any GPU, or on Mesa.
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=gl-egl",
    "--ignore-gpu-blocklist",
]
SHADER = """
#uicontrol invlerp normalized(range=[60, 230])
void main() {
  float v = normalized();
  emitRGBA(vec4(vec3(0.93, 0.89, 0.82) * v, v * v));
}
"""
COLORS = 64  # of the kept picture, so that it stays small
WAIT_MS = 120_000


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """Serve the volumes of a folder to pages of any origin; gives the address."""
    process = subprocess.Popen(  # noqa: S603  it is our own command
        [sys.executable, "-m", "octobrick.server.cli", "serve", str(folder), "--port", "0"],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"OCTOBRICK_CORS_ORIGINS": '["*"]'},
    )
    assert process.stdout
    try:
        yield "http://127.0.0.1:" + process.stdout.readline().rsplit(":", 1)[1].strip()
    finally:
        process.terminate()
        process.wait()


def make_volume(folder: Path) -> None:
    """Ingest the head from a file that names its unit, which MetaImage does not."""
    voxels = np.frombuffer(zlib.decompress(VOXELS.read_bytes()), np.uint8).reshape(SHAPE_ZYX)
    sizes = dict(zip(("X", "Y", "Z"), SPACING_MM_XYZ, strict=True))
    metadata: dict[str, Any] = {f"PhysicalSize{axis}": size for axis, size in sizes.items()}
    metadata |= {f"PhysicalSize{axis}Unit": "mm" for axis in sizes}
    tifffile.imwrite(folder / "head.ome.tif", voxels, metadata=metadata | {"axes": "ZYX"})
    ingest(folder / "head.ome.tif", folder / "head.zarr")


def viewer_of(source: str) -> Any:
    """A viewer of one volume: a cross section, and all of it by volume rendering."""
    viewer = neuroglancer.Viewer()
    with viewer.txn() as state:
        state.layers["head"] = neuroglancer.ImageLayer(
            source=source,
            shader=SHADER,
            volume_rendering_mode="on",
            volume_rendering_depth_samples=512,
            volume_rendering_gain=2,
        )
        state.layout = "xy-3d"
        state.dimensions = neuroglancer.CoordinateSpace(
            names=["x", "y", "z"], units="mm", scales=SPACING_MM_XYZ
        )
        state.display_dimensions = ["x", "y", "z"]
        state.position = [256, 256, 117]
        state.cross_section_scale = 1.2
        state.cross_section_background_color = "#000000"
        state.show_slices = False
        state.projection_scale = 340
        state.projection_orientation = [-0.68, 0.18, -0.18, 0.68]  # from the front, z upwards
    return viewer


def picture_of(page: Page, viewer: Any) -> Image.Image:
    """What the viewer shows once all that it needs is there."""
    page.goto(viewer.get_viewer_url())
    page.wait_for_function("() => window.viewer?.isReady?.() ?? false", timeout=WAIT_MS)
    page.wait_for_timeout(1000)  # the last frame is drawn after that
    page.wait_for_function("() => window.viewer.isReady()", timeout=WAIT_MS)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def main(out: Path) -> int:
    """Make the picture anew."""
    neuroglancer.set_server_bind_address("127.0.0.1")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        make_volume(folder)
        browser = playwright.chromium.launch(
            executable_path=os.environ.get("CHROMIUM", "/usr/bin/chromium"), args=FLAGS
        )
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        with serving(folder) as url:
            views = [picture_of(page, viewer_of(source.format(url=url))) for source in SOURCES]
        browser.close()
    both = Image.new("RGB", (sum(view.width for view in views), views[0].height))
    for i, view in enumerate(views):
        both.paste(view, (i * view.width, 0))
    both.quantize(COLORS).save(out, optimize=True)
    _say(out.name, out.stat().st_size, "bytes")
    return 0


def _say(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")


if __name__ == "__main__":
    sys.exit(main(DOCS / "images" / "neuroglancer.png"))
