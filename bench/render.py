"""Our pictures and frame times beside VTK's GPU ray caster: same volume, camera, transfer function.

    script/bench render [--source FILE] [--side 512] [--zoom 2] [--frames 5] [--rounds 3]

Unshaded, and shaded with the same Blinn-Phong terms and a light at the eye; ours from S3Dc code of
4 bits, also deblocked, VTK's from raw voxels. Each round runs both sides in fresh processes, in
turn, so that a machine whose speed drifts is fair to both. Every frame has another azimuth. Ours
are timed twice: with what earlier frames left in memory, and cold, with reading, decoding and
upload in every frame. Prints the similarity of the pictures (SSIM, PSNR) and the medians of the
frame times; writes the pictures to bench/out/. A side whose picture is empty fails: a context that
could not be made returns at once and would look fast.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import _measure
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from octobrick.renderer import Camera, Renderer
    from octobrick.store import Volume

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "bench" / "out"

# Plain enough to be said in the words of both: values (of uint8 data), colour, opacity per voxel.
POINTS = [
    (0, (0.0, 0.0, 0.0), 0.0),
    (40, (0.4, 0.2, 0.1), 0.0),
    (90, (0.8, 0.4, 0.3), 0.02),
    (140, (0.9, 0.8, 0.6), 0.15),
    (255, (1.0, 1.0, 0.95), 0.8),
]
ELEVATION = 20.0
FOV_DEGREES = 30.0
STEP_VOXELS = 0.5
# What ours and VTK's are asked for, by the name of the row.
OURS: dict[str, dict[str, Any]] = {
    "unshaded": {"shading": False},
    "shaded": {},
    "shaded, deblocked": {"deblocking": True},
}
VTK_SHADES = {"unshaded": False, "shaded": True}
# Each of ours beside what of VTK's.
PAIRS = {"unshaded": "unshaded", "shaded": "shaded", "shaded, deblocked": "shaded"}


def main() -> None:
    arguments = parse_arguments()
    if arguments.side_to_run:
        print(json.dumps(RUNNERS[arguments.side_to_run](arguments)))
        return
    OUT.mkdir(parents=True, exist_ok=True)
    prepare(arguments)
    rounds = [
        {side: run_apart(side, arguments) for side in RUNNERS} for _ in range(arguments.rounds)
    ]
    report(arguments, rounds)


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--source", default=str(ROOT / "data" / "ct_vhf_head.mhd"))
    parser.add_argument("--side", type=int, default=512, help="pixels of the square picture")
    parser.add_argument("--zoom", type=float, default=2.0, help="1: all of the volume is in view")
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--side-to-run", choices=("ours", "vtk"), help=argparse.SUPPRESS)
    return parser.parse_args()


def prepare(arguments: argparse.Namespace) -> None:
    """Ingest the source, lossy as by default and exact, once."""
    from octobrick.codec import S3dc
    from octobrick.store import ingest

    for name, codec in (("s3dc", S3dc()), ("lossless", None)):
        ingest(arguments.source, OUT / f"vtk_{name}.zarr", codec=codec, overwrite=True)


def run_apart(side: str, arguments: argparse.Namespace) -> dict[str, Any]:
    command = [sys.executable, __file__, "--side-to-run", side, "--source", arguments.source]
    command += ["--side", str(arguments.side), "--frames", str(arguments.frames)]
    command += ["--zoom", str(arguments.zoom)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def camera_of(frame: int, volume: Volume, zoom: float) -> Camera:
    from octobrick.renderer import Camera

    orbit = Camera.orbit(volume, 30.0 + 7.0 * frame, ELEVATION, fov_degrees=FOV_DEGREES)
    return orbit.zoomed(zoom)


def run_ours(arguments: argparse.Namespace) -> dict[str, Any]:
    from octobrick.renderer import Renderer
    from octobrick.store import open_volume

    volume, exact = open_volume(OUT / "vtk_s3dc.zarr"), open_volume(OUT / "vtk_lossless.zarr")
    kinds = {}
    with Renderer() as renderer:
        for kind, scene in OURS.items():
            frames = [
                ours_frame(renderer, volume, i, scene, arguments)
                for i in range(arguments.frames + 1)
            ]
            # Then each frame starts with nothing: reading, decoding and upload count.
            cold = []
            for i in range(arguments.frames):
                renderer.forget_bricks()
                cold.append(ours_frame(renderer, volume, i + 1, scene, arguments)[1])
            np.save(
                OUT / f"vtk_ours_lossless_{kind}.npy",
                ours_frame(renderer, exact, 0, scene, arguments)[0],
            )
            kinds[kind] = finish(
                "ours",
                kind,
                frames[0][0],
                [seconds for _, seconds in frames],
                {"cold_seconds": cold},
            )
        return {"kinds": kinds, "renderer": renderer.gl_renderer, "decodes_on": renderer.decodes_on}


def ours_frame(
    renderer: Renderer,
    volume: Volume,
    frame: int,
    scene: dict[str, Any],
    arguments: argparse.Namespace,
) -> tuple[NDArray[np.uint8], float]:
    from octobrick.renderer import TransferFunction

    transfer = TransferFunction(
        colors=tuple((value, rgb) for value, rgb, _ in POINTS),
        opacities=tuple((value, alpha) for value, _, alpha in POINTS),
        domain="value",
    )
    camera = camera_of(frame, volume, arguments.zoom)
    size = (arguments.side, arguments.side)
    start = time.perf_counter()
    image = renderer.render(
        volume, camera, transfer, size, step_voxels=STEP_VOXELS, level=0, **scene
    )
    return image.rgba[..., :3], time.perf_counter() - start


def run_vtk(arguments: argparse.Namespace) -> dict[str, Any]:
    import vtk

    from octobrick.store import open_volume

    volume = open_volume(OUT / "vtk_lossless.zarr")
    kinds = {}
    for kind, shaded in VTK_SHADES.items():
        window, scene = vtk_window(volume, shaded, arguments.side)
        frames = [
            vtk_frame(window, scene, volume, i, arguments) for i in range(arguments.frames + 1)
        ]
        kinds[kind] = finish("vtk", kind, frames[0][0], [seconds for _, seconds in frames], {})
    return {"kinds": kinds, "version": vtk.vtkVersion.GetVTKVersion()}


def vtk_window(volume: Volume, shaded: bool, side: int) -> tuple[Any, Any]:
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk

    level = volume.level(0)
    image = vtk.vtkImageData()
    nz, ny, nx = level.shape_zyx
    image.SetDimensions(nx, ny, nz)
    image.SetSpacing(*level.spacing_xyz)
    image.GetPointData().SetScalars(numpy_to_vtk(volume.read(0).ravel(), deep=True))
    mapper = vtk.vtkGPUVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.AutoAdjustSampleDistancesOff()
    mapper.LockSampleDistanceToInputSpacingOff()
    mapper.SetSampleDistance(STEP_VOXELS * min(level.spacing_xyz))
    mapper.UseJitteringOff()
    actor = vtk.vtkVolume()
    actor.SetMapper(mapper)
    actor.SetProperty(vtk_look(min(level.spacing_xyz), shaded))
    scene = vtk.vtkRenderer()
    scene.AddVolume(actor)
    scene.SetBackground(0, 0, 0)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(side, side)
    window.AddRenderer(scene)
    return window, scene


def vtk_look(voxel_world: float, shaded: bool) -> Any:
    import vtk

    from octobrick.renderer import Lighting

    colour, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    for value, point_rgb, alpha in POINTS:
        colour.AddRGBPoint(value, *point_rgb)
        opacity.AddPoint(value, alpha)
    look, light = vtk.vtkVolumeProperty(), Lighting()
    look.SetColor(colour)
    look.SetScalarOpacity(opacity)
    look.SetScalarOpacityUnitDistance(voxel_world)
    look.SetInterpolationTypeToLinear()
    look.SetShade(shaded)
    look.SetAmbient(light.ambient)
    look.SetDiffuse(light.diffuse)
    look.SetSpecular(light.specular)
    look.SetSpecularPower(light.shininess)
    return look


def vtk_frame(
    window: Any, scene: Any, volume: Volume, frame: int, arguments: argparse.Namespace
) -> tuple[NDArray[np.uint8], float]:
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    side, camera = arguments.side, camera_of(frame, volume, arguments.zoom)
    view = scene.GetActiveCamera()
    view.SetPosition(*camera.eye_world_xyz)
    view.SetFocalPoint(*camera.target_world_xyz)
    view.SetViewUp(*camera.up_world_xyz)
    view.SetViewAngle(FOV_DEGREES)
    scene.ResetCameraClippingRange()
    start = time.perf_counter()
    window.Render()
    pixels = vtk.vtkUnsignedCharArray()
    window.GetPixelData(0, 0, side - 1, side - 1, 1, pixels, 0)
    seconds = time.perf_counter() - start
    return vtk_to_numpy(pixels).reshape(side, side, 3)[::-1].copy(), seconds


RUNNERS = {"ours": run_ours, "vtk": run_vtk}


def finish(
    side: str, kind: str, rgb: NDArray[np.uint8], seconds: list[float], more: dict[str, Any]
) -> dict[str, Any]:
    """Of one kind of picture: the first frame compiles shaders and is told apart."""
    if rgb.max() < 64 or np.ptp(rgb) == 0:
        raise SystemExit(f"{side}, {kind}: the picture is empty (largest value {rgb.max()})")
    np.save(OUT / f"vtk_{side}_{kind}.npy", rgb)
    return {"first_seconds": seconds[0], "seconds": seconds[1:], **more}


def report(arguments: argparse.Namespace, rounds: list[dict[str, Any]]) -> None:
    rows = [row(kind, rounds) for kind in OURS]
    ours, vtk = (rounds[0][side] for side in ("ours", "vtk"))
    result = {
        "source": Path(arguments.source).name,
        "side": arguments.side,
        "zoom": arguments.zoom,
        "gl_renderer": ours["renderer"],
        "decodes_on": ours["decodes_on"],
        "vtk": vtk["version"],
        "rows": rows,
        "rounds": rounds,
    }
    if arguments.json:
        print(json.dumps(result, indent=1))
        return
    print(f"{result['source']}, {arguments.side}² pixels, {ours['renderer']}, VTK {vtk['version']}")
    head = ["", "ours ms", "cold ms", "VTK ms", "ours/VTK", "cold/VTK"]
    head += ["SSIM lossless, VTK", "dB", "SSIM S3Dc, lossless", "dB"]
    cells = [
        [r["kind"], *(f"{1e3 * r[n]:.0f}" for n in ("ours", "cold", "vtk"))]
        + [f"{r[n]:.2f}" for n in ("ratio", "cold_ratio")]
        + [f"{r['exact_vtk'][n]:.{d}f}" for n, d in (("ssim", 3), ("psnr", 1))]
        + [f"{r['s3dc_exact'][n]:.{d}f}" for n, d in (("ssim", 3), ("psnr", 1))]
        for r in rows
    ]
    print(_measure.layout(head, cells))
    print(f"pictures: {OUT}/render_*.png (ours, VTK, difference)")


def row(kind: str, rounds: list[dict[str, Any]]) -> dict[str, Any]:
    """Medians over all rounds; ratios round by round, so that both sides had the same machine."""
    from PIL import Image

    def medians(side: str, name: str, what: str) -> NDArray[np.float64]:
        return np.array([np.median(r[side]["kinds"][name][what]) for r in rounds])

    warm, cold = medians("ours", kind, "seconds"), medians("ours", kind, "cold_seconds")
    peer = medians("vtk", PAIRS[kind], "seconds")
    ours, exact, vtk = (
        np.load(OUT / f"vtk_{n}.npy")
        for n in (f"ours_{kind}", f"ours_lossless_{kind}", f"vtk_{PAIRS[kind]}")
    )
    difference = np.abs(exact.astype(int) - vtk).astype(np.uint8)
    name = kind.replace(", ", "-")
    Image.fromarray(np.hstack([ours, vtk, difference])).save(OUT / f"render_{name}.png")
    return {
        "kind": kind,
        "ours": float(np.median(warm)),
        "cold": float(np.median(cold)),
        "vtk": float(np.median(peer)),
        "ratio": float(np.median(warm / peer)),
        "cold_ratio": float(np.median(cold / peer)),
        "exact_vtk": likeness(exact, vtk),
        "s3dc_exact": likeness(exact, ours),
    }


def likeness(wanted: NDArray[np.uint8], found: NDArray[np.uint8]) -> dict[str, float]:
    from octobrick.codec import metrics

    return {
        "ssim": metrics.ssim(wanted, found, peak=255),
        "psnr": metrics.psnr(wanted, found, peak=255),
    }


if __name__ == "__main__":
    main()
