"""``octobrick info``: what is in a volume or in a source file."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from octobrick.server.cli.source_options import camera_options, open_given, source_options
from octobrick.server.cli.text import (
    format_nbytes,
    format_psnr,
    format_ratio,
    format_shape,
    print_table,
)

if TYPE_CHECKING:
    from octobrick.store import Volume


@click.command()
@click.argument("path")
@source_options
@camera_options
@click.option("--json", "as_json", is_flag=True, help="Print all of it as JSON.")
def info(path: str, as_json: bool, **options: Any) -> None:
    """Tell what is in PATH: a volume, or a file, folder, pattern or address of either."""
    from octobrick.store import open_volume
    from octobrick.store.opening import is_volume

    if is_volume(path):
        with open_volume(path) as volume:
            if as_json:
                click.echo(json.dumps(volume.metadata()))
            else:
                _print_volume(volume)
        return
    with open_given(path, options) as source:
        description = source.describe()
    if as_json:
        click.echo(json.dumps(description))
    else:
        _print_fields(description)


def _print_volume(volume: Volume) -> None:
    from octobrick.store.brick_codec import codec_text

    spacing = ", ".join(f"{size:g}" for size in volume.levels[0].spacing_xyz)
    low, high = volume.value_range
    dark, bright = volume.window
    _print_fields(
        {
            "volume": volume.name,
            "revision": volume.revision,
            "dtype": str(volume.dtype),
            "brick": format_shape(volume.brick_shape_zyx),
            "time steps": volume.nt,
            "channels": volume.nc,
            "spacing (x, y, z)": f"{spacing} {volume.unit or ''}".rstrip(),
            "values": f"{low:g} to {high:g}",
            "window": f"{dark:g} to {bright:g}",
            "gradients": _gradient_levels(volume),
            **_cameras(volume),
        }
    )
    print_table(
        ("level", "z×y×x", "bricks", "size", "stored", "ratio", "PSNR", "max error", "codec"),
        (
            (
                str(level.index),
                format_shape(level.shape_zyx),
                format_shape(level.grid_zyx),
                format_nbytes(level.nbytes),
                format_nbytes(level.stored_nbytes),
                format_ratio(level.nbytes, level.stored_nbytes),
                format_psnr(level.psnr_db),
                f"{level.max_error:g}",
                codec_text(volume.level_codec(level.index)),
            )
            for level in volume.levels
        ),
    )


def _gradient_levels(volume: Volume) -> str | None:
    stored = volume.gradients
    return None if stored is None else f"of levels {stored.levels[0]} to {stored.levels[-1]}"


def _cameras(volume: Volume) -> dict[str, str]:
    grid = volume.light_field
    if grid is None:
        return {}
    step = ", ".join(f"{size:g}" for size in grid.step.uv)
    return {
        "views (u × v)": f"{grid.nu} × {grid.nv}",
        "camera step (u, v)": f"{step} {grid.step.unit or ''}".rstrip(),
    }


def _print_fields(fields: dict[str, Any]) -> None:
    width = max(map(len, fields))
    for name, value in fields.items():
        click.echo(f"{name:<{width}}  {'–' if value is None else value}")
