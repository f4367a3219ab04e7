"""A measurement as tables for people."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from octobrick.server.cli.text import format_psnr, format_seconds, format_shape, print_table

if TYPE_CHECKING:
    from octobrick.measure import CodeRow, Measurement, PictureRow
    from octobrick.measure.extremes import StressRow

_PICTURES_MAX = 12  # rows, the best; the report has all


def print_measurement(found: Measurement) -> None:
    """What was measured, the settings that none beats, levels, pictures, and what to do."""
    _print_source(found)
    labels = {label: rank for rank, label in enumerate(found.front)}
    front = [row for row in found.codes if row.setting.label in labels]
    _print_codes(sorted(front, key=lambda row: labels[row.setting.label]))
    click.echo(
        f"{len(front)} of {len(found.codes)} settings, those that none beats in bits on disk and "
        "PSNR; sizes in bits a voxel, rates in Mvoxel/s of one thread\n"
    )
    if found.levels:
        print_table(
            ("level", "PSNR", "max error", "RMSE"),
            [
                (f"{r.level}", format_psnr(r.psnr_db), f"{r.max_error:.4g}", f"{r.rmse:.4g}")
                for r in found.levels
            ],
        )
    if found.pictures:
        _print_pictures(found.pictures)
    for note in found.skipped:
        click.echo(f"octobrick: not measured: {note}", err=True)
    for one in found.recommendations:
        click.echo(f"target {one.target}{'' if one.met else ', which nothing meets'}: {one.reason}")
        click.echo(f"  {one.ingest_command}")
        if one.render_command:
            click.echo(f"  {one.render_command}")
    click.echo(f"measured in {format_seconds(found.elapsed_seconds)}")


def print_stress(rows: Sequence[StressRow]) -> None:
    """How far each system keeps its promises: a line for each parameter, a failure below it."""
    from octobrick.measure.extremes import table_rows

    cells = list(zip(rows, table_rows(rows), strict=True))
    widths = [max((len(line[column]) for _, line in cells), default=0) for column in (1, 2, 4)]
    for (system, promise), group in itertools.groupby(
        cells, key=lambda cell: (cell[1][0], cell[0].promise)
    ):
        click.echo(f"{system}: {promise}")
        for _, (_, parameter, held, _, worst, tolerance, failure) in group:
            texts = zip((parameter, held, worst), widths, strict=True)
            line = "  ".join(text.ljust(width) for text, width in texts)
            click.echo(f"  {line}  of {tolerance}" if tolerance else f"  {line}".rstrip())
            if failure:
                click.echo(f"      broken {failure}")
    click.echo(
        "Each line: what was varied, from where to where the promise held, the worst value with "
        "its place, of what is allowed."
    )


def _print_source(found: Measurement) -> None:
    source, sample = found.source, found.sample
    low, high = source["value_range"]
    click.echo(
        f"{source['name']}: {source['format']}, {source['dtype']}, "
        f"{format_shape(source['shape_zyx'])} voxels (z×y×x), values {low:g} to {high:g} "
        f"({source['value_range_of']})"
    )
    click.echo(
        f"{sample['bricks']} of {sample['bricks_of_level_0']} bricks were coded, "
        f"{100 * sample['share_of_voxels']:.0f} % of the voxels"
    )
    stored = source["stored"]
    if stored and not stored["lossless"]:
        click.echo(
            f"octobrick: the volume is lossy ({stored['codec']}: "
            f"{format_psnr(stored['psnr_db'])}, max error {stored['max_error']:g}, RMSE "
            f"{stored['rmse']:.4g} against its original); everything here is against what it "
            "stores, so errors come on top of these",
            err=True,
        )


def _print_codes(rows: Sequence[CodeRow]) -> None:
    print_table(
        ("setting", "on disk", "in memory", "PSNR", "SSIM", "max error", "encode", "decode"),
        [
            (
                row.setting.label,
                f"{row.disk_bits:.2f}",
                f"{row.resident_bits:.2f}",
                format_psnr(row.psnr_db),
                f"{row.ssim:.4f}",
                f"{row.max_error:.4g}",
                _rate(row.encode_voxels_per_second),
                _rate(row.decode_voxels_per_second),
            )
            for row in rows
        ],
    )


def _print_pictures(rows: Sequence[PictureRow]) -> None:
    best = sorted(rows, key=lambda row: row.frame_seconds)[:_PICTURES_MAX]
    print_table(
        ("setting", "drawn", "frame", "PSNR", "SSIM"),
        [
            (
                row.setting.label,
                row.path,
                f"{1000 * row.frame_seconds:.0f} ms",
                "same" if row.psnr_db is None else f"{row.psnr_db:.1f} dB",
                f"{row.ssim:.4f}",
            )
            for row in best
        ],
    )
    click.echo(f"the {len(best)} fastest of {len(rows)} pictures; the report has all\n")


def _rate(voxels_per_second: float) -> str:
    return (
        f"{voxels_per_second / 1e6:,.0f}"
        if voxels_per_second >= 1e7
        else (f"{voxels_per_second / 1e6:.1f}" if voxels_per_second else "–")
    )
