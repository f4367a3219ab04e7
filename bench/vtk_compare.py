"""Our pictures and frame times beside VTK's GPU ray caster: same volume, camera, transfer function.

    script/bench vtk_compare [--source FILE] [--side 512] [--zoom 2] [--frames 5] [--rounds 3]

Each round runs both sides in fresh processes, in turn, so that a machine whose speed drifts is fair
to both. Every frame has another azimuth. Ours are timed twice: with the bricks that earlier frames
left on the GPU, and cold, with upload and decoding in every frame. Prints the similarity of the
pictures (SSIM, PSNR) and the medians of the frame times; writes the pictures to bench/out/. A side
whose picture is empty fails: a context that could not be made returns at once and would look fast.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from octobrick.renderer import Camera
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
    from octobrick.renderer import Renderer, TransferFunction
    from octobrick.store import open_volume

    volume = open_volume(OUT / "vtk_s3dc.zarr")
    transfer = TransferFunction(
        colors=tuple((value, rgb) for value, rgb, _ in POINTS),
        opacities=tuple((value, alpha) for value, _, alpha in POINTS),
        domain="value",
    )
    size = (arguments.side, arguments.side)
    seconds = []
    with Renderer() as renderer:
        # The second half starts each frame with nothing on the GPU: upload and decode count.
        for frame in range(2 * arguments.frames + 1):
            camera = camera_of(frame, volume, arguments.zoom)
            if frame > arguments.frames:
                renderer.forget_bricks()
            start = time.perf_counter()
            image = renderer.render(
                volume, camera, transfer, size=size, shading=False, step_voxels=STEP_VOXELS, level=0
            )
            seconds.append(time.perf_counter() - start)
            if frame == 0:
                rgb = image.rgba[..., :3]
        exact = renderer.render(
            open_volume(OUT / "vtk_lossless.zarr"),
            camera_of(0, volume, arguments.zoom),
            transfer,
            size=size,
            shading=False,
            step_voxels=STEP_VOXELS,
            level=0,
        ).rgba[..., :3]
        name = renderer.gl_renderer
    np.save(OUT / "vtk_ours_lossless.npy", exact)
    warm, cold = seconds[: arguments.frames + 1], seconds[arguments.frames + 1 :]
    more = {"gl_renderer": name, "cold_frame_seconds": cold, "stats": image.stats.to_dict()}
    return finish("ours", rgb, warm, more)


def run_vtk(arguments: argparse.Namespace) -> dict[str, Any]:
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    from octobrick.store import open_volume

    volume = open_volume(OUT / "vtk_lossless.zarr")
    level = volume.level(0)
    voxels = volume.read(0)
    image = vtk.vtkImageData()
    nz, ny, nx = level.shape_zyx
    image.SetDimensions(nx, ny, nz)
    image.SetSpacing(*level.spacing_xyz)
    image.GetPointData().SetScalars(numpy_to_vtk(voxels.ravel()))

    colour, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    for value, point_rgb, alpha in POINTS:
        colour.AddRGBPoint(value, *point_rgb)
        opacity.AddPoint(value, alpha)
    step = STEP_VOXELS * min(level.spacing_xyz)
    mapper = vtk.vtkGPUVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.AutoAdjustSampleDistancesOff()
    mapper.LockSampleDistanceToInputSpacingOff()
    mapper.SetSampleDistance(step)
    mapper.UseJitteringOff()
    properties = vtk.vtkVolumeProperty()
    properties.SetColor(colour)
    properties.SetScalarOpacity(opacity)
    properties.SetScalarOpacityUnitDistance(min(level.spacing_xyz))
    properties.SetInterpolationTypeToLinear()
    properties.ShadeOff()
    actor = vtk.vtkVolume()
    actor.SetMapper(mapper)
    actor.SetProperty(properties)
    scene = vtk.vtkRenderer()
    scene.AddVolume(actor)
    scene.SetBackground(0, 0, 0)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(arguments.side, arguments.side)
    window.AddRenderer(scene)

    seconds = []
    for frame in range(arguments.frames + 1):
        camera = camera_of(frame, volume, arguments.zoom)
        view = scene.GetActiveCamera()
        view.SetPosition(*camera.eye_world_xyz)
        view.SetFocalPoint(*camera.target_world_xyz)
        view.SetViewUp(*camera.up_world_xyz)
        view.SetViewAngle(FOV_DEGREES)
        scene.ResetCameraClippingRange()
        start = time.perf_counter()
        window.Render()
        pixels = vtk.vtkUnsignedCharArray()
        window.GetPixelData(0, 0, arguments.side - 1, arguments.side - 1, 1, pixels, 0)
        seconds.append(time.perf_counter() - start)
        if frame == 0:
            rgb = vtk_to_numpy(pixels).reshape(arguments.side, arguments.side, 3)[::-1].copy()
    return finish("vtk", rgb, seconds, {"version": vtk.vtkVersion.GetVTKVersion()})


RUNNERS = {"ours": run_ours, "vtk": run_vtk}


def finish(
    side: str, rgb: NDArray[np.uint8], seconds: list[float], more: dict[str, Any]
) -> dict[str, Any]:
    if rgb.max() < 64 or np.ptp(rgb) == 0:
        raise SystemExit(f"{side}: the picture is empty (largest value {rgb.max()})")
    from PIL import Image

    np.save(OUT / f"vtk_{side}.npy", rgb)
    Image.fromarray(rgb).save(OUT / f"vtk_{side}.png")
    return {"first_seconds": seconds[0], "frame_seconds": seconds[1:], **more}


def report(arguments: argparse.Namespace, rounds: list[dict[str, Any]]) -> None:
    from PIL import Image

    from octobrick.codec import metrics

    ours, exact, vtk = (np.load(OUT / f"vtk_{n}.npy") for n in ("ours", "ours_lossless", "vtk"))
    difference = np.abs(exact.astype(int) - vtk).astype(np.uint8)
    Image.fromarray(np.hstack([ours, vtk, difference])).save(OUT / "vtk_side_by_side.png")

    def median(side: str, what: str) -> float:
        return float(np.median(np.concatenate([np.atleast_1d(r[side][what]) for r in rounds])))

    def ratio(what: str) -> float:
        """Round by round, so that both sides had the same machine."""
        ours, vtk = (
            [np.median(r[side][what_of]) for r in rounds]
            for side, what_of in (("ours", what), ("vtk", "frame_seconds"))
        )
        return float(np.median(np.divide(ours, vtk)))

    result = {
        "source": Path(arguments.source).name,
        "side": arguments.side,
        "zoom": arguments.zoom,
        "ssim_ours_vtk": metrics.ssim(ours, vtk, peak=255),
        "ssim_lossless_vtk": metrics.ssim(exact, vtk, peak=255),
        "psnr_lossless_vtk": metrics.psnr(exact, vtk, peak=255),
        "psnr_s3dc_lossless": metrics.psnr(exact, ours, peak=255),
        "ssim_s3dc_lossless": metrics.ssim(exact, ours, peak=255),
        "ours_first_seconds": median("ours", "first_seconds"),
        "vtk_first_seconds": median("vtk", "first_seconds"),
        "ours_frame_seconds": median("ours", "frame_seconds"),
        "ours_cold_frame_seconds": median("ours", "cold_frame_seconds"),
        "vtk_frame_seconds": median("vtk", "frame_seconds"),
        "frame_ratio_ours_over_vtk": ratio("frame_seconds"),
        "cold_frame_ratio_ours_over_vtk": ratio("cold_frame_seconds"),
        "rounds": rounds,
    }
    if arguments.json:
        print(json.dumps(result, indent=1))
        return
    for name, value in result.items():
        if name != "rounds":
            print(f"{name:28} {value:.4g}" if isinstance(value, float) else f"{name:28} {value}")
    print(f"{'pictures':28} {OUT / 'vtk_side_by_side.png'}  (ours, VTK, difference)")


if __name__ == "__main__":
    main()
