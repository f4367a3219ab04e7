"""S3Dc, Table 1 and Figures 5, 9, 10, 11: ratio, frame rate, PSNR and SSIM by bits and block.

    script/bench papers/s3dc_table1 [--data ../shared/data] [--quick] [--json FILE]

The paper's 14 settings. Ratios: bytes of a code of 486 × 512 × 512 voxels of 16 bits, and of our
volumes. Pictures: unshaded, beside that of the uncompressed volume with linear interpolation, by
the nearest voxel, drawn from the codes themselves, and linear, from decoded slabs; of the first
setting the linear picture is drawn from the codes too and is the same. PSNR with peak 255. Frame
times of one volume and some settings, in turn: only their ratios mean anything.
"exact" is S3Dc with 8 bits and blocks of 2³, as good as no compression: what it is short of the
reference is what the nearest voxel costs by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import _measure
import _paper
import numpy as np
from _s3dc_published import TABLE_1, Published
from _scenes import SCENES, Scene, camera_of, likeness, stored
from numpy.typing import NDArray
from s3dc_rate import measured
from volumes import source_crop

from octobrick.codec import S3dc
from octobrick.codec.metrics import max_error
from octobrick.renderer import Camera, Renderer, TransferFunction
from octobrick.store import Volume

FILES = ("ct_cranium.nrrd", "mri_vs_t1c.nii.gz", "ct_vhf_head.mhd")  # int16, uint16, uint8
TIMED = "ct_cranium.nrrd"
PAPER_SHAPE_ZYX = (486, 512, 512)
SIDE, TIMED_SIDE = 320, 160  # pixels of the square pictures
BRICK = 128  # the largest block fits
WHOLE = 10**9  # voxels per axis: no volume reaches it
EXACT = S3dc((2, 2, 2), 8)
SAMPLINGS = ("nearest", "linear", "shared")
TIMED_EDGES = (4, 16, 64)


class View:
    """One volume and how it is looked at; draws any version of it."""

    def __init__(self, renderer: Renderer, exact: Volume, scene: Scene) -> None:
        self.renderer = renderer
        self.window = exact.window
        self.camera: Camera
        self.function: TransferFunction
        self.camera, self.function = camera_of(exact, scene)

    def draw(self, volume: Volume, side: int = SIDE, **how: Any) -> NDArray[np.uint8]:
        """Level 0; `how` is what `Renderer.render` takes."""
        image = self.renderer.render(
            volume,
            self.camera,
            self.function,
            (side, side),
            level=0,
            window=self.window,
            **{"shading": False, **how},
        )
        return image.rgba[..., :3]

    def published(self) -> dict[str, Any]:
        """What decides on the picture."""
        return {"transfer_function": self.function.to_json(), "window": list(self.window)}


def coded(scene: Scene, data: Path, codec: S3dc | None) -> Volume:
    name = "exact" if codec is None else "coded"
    return stored(scene, data, name, codec=codec, brick=BRICK, levels=1)


def rows_of(view: View, exact: Volume, scene: Scene, options: Any) -> Iterator[dict[str, Any]]:
    """A row for each setting."""
    voxels = source_crop(options.data / scene.file, WHOLE)
    plain = view.draw(exact)
    ceiling = view.draw(coded(scene, options.data, EXACT), direct="nearest")
    yield {"exact": likeness(plain, ceiling)}
    for published in chosen(options.quick):
        codec = S3dc((published.edge,) * 3, published.bits)
        code = codec.encode(voxels)
        volume = coded(scene, options.data, codec)
        row = {
            "bits": published.bits,
            "edge": published.edge,
            "volume_ratio": voxels.nbytes / len(code),
            "voxels": measured(voxels, codec.decode(code, voxels.shape, voxels.dtype), code),
            "nearest": likeness(plain, view.draw(volume, direct="nearest")),
            "linear": likeness(plain, view.draw(volume)),
        }
        if published is TABLE_1[0]:
            direct = view.draw(volume, direct="linear")
            row["direct_less_slab_levels"] = max_error(view.draw(volume), direct)
        if scene.file == TIMED and published.edge in TIMED_EDGES:
            row["seconds"] = seconds(view, volume)
        print(f"# {scene.file}: {published.bits} bits, {published.edge}³", flush=True)
        yield row


def seconds(view: View, volume: Volume) -> dict[str, float]:
    """Median frame times of each way, everything resident."""
    calls = {
        how: partial(view.draw, volume, TIMED_SIDE, direct=direct)
        for how, direct in (("slab", None), *zip(SAMPLINGS, SAMPLINGS, strict=True))
    }
    return _measure.alternating(calls, rounds=1)


def chosen(quick: bool) -> tuple[Published, ...]:
    return tuple(p for p in TABLE_1 if p.edge in (4, 16)) if quick else TABLE_1


def paper_ratios() -> list[dict[str, float]]:
    """Compression of the paper's volume: bytes, not voxels, matter."""
    return [
        {
            "bits": p.bits,
            "edge": p.edge,
            "published": p.ratio,
            "ours": S3dc((p.edge,) * 3, p.bits).compression_ratio(PAPER_SHAPE_ZYX, "uint16"),
        }
        for p in TABLE_1
    ]


def run(options: Any) -> dict[str, Any]:
    found: dict[str, Any] = {"ratios": paper_ratios(), "volumes": {}}
    with Renderer("1GiB") as renderer:
        found["gl_renderer"] = renderer.gl_renderer
        for scene in SCENES:
            if scene.file not in FILES[: 1 if options.quick else None]:
                continue
            exact = coded(scene, options.data, None)
            view = View(renderer, exact, scene)
            first, *rows = rows_of(view, exact, scene, options)
            found["volumes"][scene.file] = {**view.published(), **first, "rows": rows}
    draw_plots(found, options.pictures)
    return found


def draw_plots(found: dict[str, Any], folder: Path) -> None:
    """Figure 5 from equation 5; Figures 10 and 11 of the first volume beside the paper's."""
    edges = sorted({p.edge for p in TABLE_1})
    with _paper.plots(folder / "s3dc-figure5", 1) as (axis,):
        for bits in (1, 2, 4, 8):
            ratios = [
                S3dc((e,) * 3, bits).compression_ratio(PAPER_SHAPE_ZYX, "uint16") for e in edges
            ]
            axis.plot(edges, ratios, marker="o", label=f"{bits} bits")
        axis.set(xscale="log", xticks=edges, xticklabels=edges, xlabel="edge of a block, voxels")
        axis.set(ylabel="compression ratio, 16-bit samples", title="Figure 5")
        axis.minorticks_off()
        axis.legend()
    for file, of_volume in found["volumes"].items():
        name = f"s3dc-figures10-11-{file.split('.')[0]}"
        with _paper.plots(folder / name, 2) as axes:
            for axis, key, scale in zip(axes, ("psnr", "ssim"), (1, 100), strict=True):
                plot_quality(axis, of_volume["rows"], key, scale)


def plot_quality(axis: Any, rows: list[dict[str, Any]], key: str, scale: float) -> None:
    """Ours in solid lines, the published in dotted ones, by edge."""
    field = {"psnr": "psnr_db", "ssim": "ssim"}[key]
    colours = iter(("tab:blue", "tab:orange", "tab:green", "tab:red"))
    for bits in (2, 4):
        for how in ("nearest", "linear"):
            colour = next(colours)
            of_bits = [row for row in rows if row["bits"] == bits]
            edges = [row["edge"] for row in of_bits]
            label = f"{bits} bits, {how}"
            ours = [scale * row[how][key] for row in of_bits]
            axis.plot(edges, ours, color=colour, marker="o", label=label)
            theirs = [p for p in TABLE_1 if p.bits == bits]
            published = [getattr(p, f"{how}_{field}") for p in theirs]
            axis.plot([p.edge for p in theirs], published, color=colour, linestyle=":")
    ticks = sorted({p.edge for p in TABLE_1})
    axis.set(xscale="log", xticks=ticks, xticklabels=ticks, xlabel="edge of a block, voxels")
    axis.minorticks_off()
    title = {"psnr": "Figure 11: PSNR, dB", "ssim": "Figure 10: SSIM, %"}[key]
    axis.set(title=f"{title} (dotted: published)")
    if key == "psnr":  # the other's colours are the same
        axis.legend(fontsize=8)


def table(found: dict[str, Any]) -> str:
    ratios = [
        _paper.Claim(f"{r['bits']:g} bits, {r['edge']:g}³", r["published"], r["ours"])
        for r in found["ratios"]
    ]
    texts = [_paper.claims_text("compression ratio, 486 × 512 × 512", ratios)]
    texts += [quality_text(file, of) for file, of in found["volumes"].items()]
    texts += [time_text(found["volumes"][TIMED]["rows"])]
    return "\n\n".join(texts)


def quality_text(file: str, of_volume: dict[str, Any]) -> str:
    """PSNR and SSIM, the paper's in brackets."""
    lines = []
    for row in of_volume["rows"]:
        p = next(p for p in TABLE_1 if (p.bits, p.edge) == (row["bits"], row["edge"]))
        lines.append(
            [f"{p.bits} bits, {p.edge}³", f"{row['volume_ratio']:.3f}"]
            + [f"{row['voxels']['psnr_db']:.2f}"]
            + [f"{row[how]['psnr']:.2f}" for how in ("nearest", "linear")]
            + [f"{p.nearest_psnr_db:.2f} {p.linear_psnr_db:.2f}"]
            + [f"{100 * row[how]['ssim']:.2f}" for how in ("nearest", "linear")]
            + [f"{p.nearest_ssim:.2f} {p.linear_ssim:.2f}"]
        )
    head = [file, "ratio", "voxels dB", "nearest dB", "linear dB", "paper n, l"]
    head += ["nearest %", "linear %", "paper n, l"]
    exact = of_volume["exact"]
    note = f"nearest, exact: {exact['psnr']:.2f} dB, {100 * exact['ssim']:.2f} %"
    look = f"transfer function over the window {of_volume['window']}:"
    return f"{_measure.layout(head, lines)}\n{note}\n{look} {of_volume['transfer_function']}"


def time_text(rows: list[dict[str, Any]]) -> str:
    """How many times as long as by the nearest voxel, the paper's ratio beside."""
    lines = []
    for row in rows:
        if "seconds" not in row:
            continue
        p = next(p for p in TABLE_1 if (p.bits, p.edge) == (row["bits"], row["edge"]))
        took = row["seconds"]
        lines.append(
            [f"{p.bits} bits, {p.edge}³"]
            + [f"{took[how] / took['nearest']:.2f}" for how in ("linear", "shared", "slab")]
            + [f"{p.nearest_fps / p.linear_fps:.2f}"]
        )
    head = ["frame time, times nearest", "linear", "shared", "slab, held", "paper, linear"]
    return _measure.layout(head, lines)


def main() -> None:
    options = _paper.parser(__doc__).parse_args()
    _measure.report(options, run(options), table)


if __name__ == "__main__":
    main()
