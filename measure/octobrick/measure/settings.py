"""The settings that are swept: what `octobrick ingest` can make, the more telling the earlier."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.measure.measurement import Setting
from octobrick.store.brick_codec import BrickCodec, require_codec
from octobrick.store.rate_target import FLATTEST, LEAST_SHARE, STEEPEST, Dial

LOSSLESS = Setting("lossless", "lossless", None, ("--codec", "lossless"))

_BITS = (4, 2, 3, 8, 1, 6)  # of an S3Dc index
_FIXED_BLOCKS = (8, 4, 16)
_BLOCKS = (4, 8)  # that can have a width each
# Bits a voxel of a brick's code; of float32, of which end points alone take one, more.
_RATES = {1: (2.0, 3.0, 1.5), 2: (3.0, 4.0, 2.0), 4: (4.0, 6.0, 3.0)}
_ERROR_SHARES = (0.01, 0.002, 0.05, 0.005, 0.02)  # of the volume's range
_DETAIL_SHARES = (0.05, 0.2, 0.01, 0.1, 0.02)
# Slopes, in squares of the range: what an index bit must gain. Each step is about 6 dB.
_SLOPE_EXPONENTS = (-12, -8, -16, -10, -14, -6)


def swept(dtype: np.dtype[Any], peak: float, *, labels: bool) -> list[Setting]:
    """All settings for voxels of a type and a range, without any twice.

    Those whose rate an ingest finds (`--psnr`) bear a provisional label until `named_by_psnr`.

    Args:
        dtype: as stored.
        peak: greatest less least voxel.
        labels: whether voxels are names, of which only exact ones are of use.
    """
    if labels:
        return [LOSSLESS]
    families = [
        list(_bounded(dtype, peak)),
        list(_found(peak)),
        list(_fixed(8)),
        list(_zerobit()),
        list(_rated(dtype)),
        list(_fixed(4)),
        list(_fixed(16)),
    ]
    settings = [LOSSLESS]
    # In turns, so that where time ends every family has its most telling members.
    for rank in range(max(map(len, families))):
        settings += [family[rank] for family in families if rank < len(family)]
    unique: dict[str, Setting] = {}
    for setting in settings:
        unique.setdefault(f"{setting.codec} {setting.family}", setting)
    return [setting for setting in unique.values() if _can_hold(setting, dtype)]


def is_found(setting: Setting) -> bool:
    """Whether an ingest finds the rate of such a setting by coding bricks."""
    return any(flag in setting.flags for flag in ("--psnr", "--ratio"))


def named_by_psnr(setting: Setting, psnr_db: float) -> Setting:
    """A setting whose rate is found, with the PSNR for which an ingest would find it."""
    flags = (*setting.flags[:-1], f"{psnr_db:.1f}")
    label = setting.family.replace("any quality", f"{psnr_db:.1f} dB")
    return dataclasses.replace(setting, label=label, flags=flags)


def found_setting(family: str, target: str, value: float, codec: BrickCodec) -> Setting:
    """A setting of which an ingest finds the rate for a target.

    Args:
        family: one of `FOUND_FAMILIES`.
        target: "psnr" or "ratio".
        value: of it.
        codec: what was found for the sampled bricks.
    """
    text = f"{value:g} dB" if target == "psnr" else f"a ratio of {value:g}"
    s3dc = "any quality" in family
    return Setting(
        label=family.replace("any quality", text) if s3dc else f"{family}, for {text}",
        family=family,
        codec=codec,
        flags=(*FOUND_FAMILIES[family][1], f"--{target}", number(value)),
    )


def position_of(codec: BrickCodec, peak: float) -> float:
    """Where a codec of `FOUND_FAMILIES` stands on its `Dial`; the inverse of `Dial.at`."""
    if isinstance(codec, Zerobit):
        return 1 - math.log(codec.ratio) / math.log(LEAST_SHARE) if codec.ratio > 0 else 0.0
    assert codec is not None
    assert codec.slope is not None
    steepest, flattest = math.log2(STEEPEST), math.log2(FLATTEST)
    return (steepest - math.log2(codec.slope / peak**2)) / (steepest - flattest)


def number(value: float) -> str:
    """As short as it can be written without becoming another."""
    short = f"{value:g}"
    return short if float(short) == value else repr(float(value))


def bounded_setting(block: int, max_error: float) -> Setting:
    """Widths of blocks such that no error is greater."""
    return Setting(
        label=f"S3Dc, error at most {max_error:.5g}, {block}³",
        family=f"S3Dc, error bound, {block}³",
        codec=S3dc((block,) * 3, max_error=max_error),
        flags=(*_s3dc(block), "--max-error", number(max_error)),
    )


def rated_setting(block: int, bits_per_voxel: float) -> Setting:
    """Widths of blocks such that each brick's code has this size."""
    return Setting(
        label=f"S3Dc, {bits_per_voxel:g} bits a voxel, {block}³",
        family=f"S3Dc, bits a voxel, {block}³",
        codec=S3dc((block,) * 3, bits_per_voxel=bits_per_voxel),
        flags=(*_s3dc(block), "--bits-per-voxel", number(bits_per_voxel)),
    )


FOUND_FAMILIES: dict[str, tuple[S3dc | Zerobit, tuple[str, ...]]] = {
    **{
        f"S3Dc, widths for any quality, {block}³": (
            S3dc((block,) * 3),
            ("--codec", "s3dc", "--block", str(block)),
        )
        for block in _BLOCKS
    },
    "zerobit": (Zerobit(), ("--codec", "zerobit")),
}
"""Of which `octobrick ingest` finds the rate for a PSNR or a ratio: what it is given for that."""


def _fixed(block: int) -> Iterator[Setting]:
    for bits in _BITS:
        yield Setting(
            label=f"S3Dc {bits} bit{'s' if bits > 1 else ''}, {block}³",
            family=f"S3Dc, fixed, {block}³",
            codec=S3dc((block,) * 3, bits=bits),
            flags=(*_s3dc(block), "--bits", str(bits)),
        )


def _bounded(dtype: np.dtype[Any], peak: float) -> Iterator[Setting]:
    for share in _ERROR_SHARES:
        error = float(f"{share * peak:.4g}")
        for block in _BLOCKS:
            # Between whole numbers there is nothing.
            yield bounded_setting(block, math.floor(error) if dtype.kind in "iu" else error)
    for block in _BLOCKS:
        yield bounded_setting(block, 0.0)


def _found(peak: float) -> Iterator[Setting]:
    if peak == 0:
        return
    for rank, exponent in enumerate(_SLOPE_EXPONENTS):
        for family, (template, flags) in FOUND_FAMILIES.items():
            if isinstance(template, S3dc) and (template.block[0] == 4 or rank < 4):
                slope = S3dc(template.block, slope=2.0**exponent)
                codec = Dial(template).at(position_of(slope, 1.0), peak)
                yield Setting(f"{family} {exponent}", family, codec, (*flags, "--psnr", "?"))


def _zerobit() -> Iterator[Setting]:
    for share in _DETAIL_SHARES:
        yield Setting(
            label=f"zerobit, {100 * share:g} % of details",
            family="zerobit",
            codec=Zerobit(share),
            flags=("--codec", "zerobit", "--details", f"{share:g}"),
        )


def _rated(dtype: np.dtype[Any]) -> Iterator[Setting]:
    for rate in _RATES[dtype.itemsize]:
        for block in _BLOCKS:
            yield rated_setting(block, rate)


def _s3dc(block: int) -> tuple[str, ...]:
    return ("--codec", "s3dc", "--block", str(block))


def _can_hold(setting: Setting, dtype: np.dtype[Any]) -> bool:
    try:
        require_codec(setting.codec, dtype)
    except UnsupportedError:
        return False
    except InvalidInputError:
        return not (setting.codec is None or isinstance(setting.codec, Zerobit))
    return True
