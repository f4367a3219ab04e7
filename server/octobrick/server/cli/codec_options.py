"""Options that say how bricks are compressed, and what they mean for `octobrick.store.ingest`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from octobrick.store.brick_codec import BrickCodec

_Command = TypeVar("_Command", bound=Callable[..., Any])

# By the codec that they belong to; of those that set a rate only one can be given.
_RATES = ("bits", "max_error", "bits_per_voxel")
_S3DC = (*_RATES, "block")
_ZEROBIT = ("details", "background")
_TARGETS = ("psnr", "ratio")  # for which a rate is found

_OPTIONS = (
    click.option(
        "--codec",
        type=click.Choice(["s3dc", "zerobit", "lossless"]),
        help="How bricks are compressed before zstd.  [default: s3dc, of labels lossless]",
    ),
    click.option("--bits", type=int, help="Bits of an S3Dc index, 1 to 8.  [default: 4]"),
    click.option(
        "--max-error", type=float, help="Largest error that S3Dc may make, instead of --bits."
    ),
    click.option(
        "--bits-per-voxel", type=float, help="Mean size of a brick's S3Dc code, instead of --bits."
    ),
    click.option(
        "--psnr",
        type=float,
        metavar="DB",
        help="Quality of each level: finds its rate by coding bricks before the ingest.",
    ),
    click.option(
        "--ratio",
        type=float,
        help="Compression ratio of each level: finds its rate likewise.",
    ),
    click.option(
        "--block",
        type=int,
        help="Voxels along each side of an S3Dc block.  [default: 8; 4 with a width per block]",
    ),
    click.option(
        "--details",
        type=float,
        help="Share of its wavelet coefficients that zerobit keeps, 0 to 1.  [default: 0.05]",
    ),
    click.option(
        "--background",
        type=float,
        help="Value of what zerobit keeps nothing of.  [default: the commonest]",
    ),
)


def codec_options(command: _Command) -> _Command:
    """Give a command the options that `take_codec` takes."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def take_codec(options: dict[str, Any]) -> dict[str, Any]:
    """The arguments ``codec``, ``psnr`` and ``ratio`` of ingest; takes their options out of all.

    Raises:
        click.UsageError: options that do not go together.
        InvalidInputError: a value that the codec cannot have.
    """
    name = options.pop("codec")
    given = {key: options.pop(key) for key in (*_S3DC, *_ZEROBIT, *_TARGETS)}
    given = {key: value for key, value in given.items() if value is not None}
    rates = [key for key in given if key in (*_RATES, "details", *_TARGETS)]
    if len(rates) > 1:
        raise click.UsageError(f"Give one of {_flags(rates)}.")
    target = {key: given.pop(key) for key in _TARGETS if key in given}
    return {"codec": _codec(name, given, found=bool(target)), **target}


def _codec(name: str | None, given: dict[str, Any], *, found: bool) -> BrickCodec:
    """The codec; where its rate is to be found, without one."""
    from octobrick.codec import S3dc, Zerobit
    from octobrick.store.ingest_options import DEFAULT_CODEC

    if name is None and not given:
        return DEFAULT_CODEC
    if name == "lossless":
        _require_only(given, (), "lossless")
        return None
    if name == "zerobit":
        _require_only(given, _ZEROBIT, name)
        return Zerobit(given.get("details", Zerobit().ratio), background=given.get("background"))
    _require_only(given, _S3DC, "s3dc")
    rate = {key: value for key, value in given.items() if key in _RATES}
    # With a width per block, small blocks cost little and gain much: docs/performance.md.
    side = given.get("block", 4 if found or rate.keys() - {"bits"} else 8)
    return S3dc(block=(side, side, side), **(rate or {"bits": 4}))


def _require_only(given: dict[str, Any], allowed: tuple[str, ...], codec: str) -> None:
    other = [key for key in given if key not in allowed]
    if other:
        raise click.UsageError(f"{_flags(other)}: not an option of {codec}; leave it out.")


def _flags(names: list[str] | tuple[str, ...]) -> str:
    return ", ".join(f"--{name.replace('_', '-')}" for name in names)
