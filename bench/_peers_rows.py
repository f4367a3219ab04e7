"""The figures of methods on a volume: sizes, errors, and rates in turn."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import _measure
import numpy as np
from _peers_method import (
    RESIDENT_ACCESS,
    Calls,
    Method,
    NotPossibleError,
    NotRunError,
    Voxels,
    value_range,
)
from volumes import central

from octobrick.codec import metrics

Row = dict[str, Any]


def rows_of(
    methods: Sequence[Method], voxels: Voxels, *, timed_crop: int, rounds: int
) -> dict[str, Row]:
    """A row for each method: figures of the volume, and rates of its middle.

    A method that fails has a row that says why, with `failed` instead of figures.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        rows = {
            method.name: _guarded(method, lambda m=method: _quality(m, voxels, folder))  # type: ignore[misc]
            for method in methods
        }
        middle = np.ascontiguousarray(voxels[central(voxels.shape, timed_crop)])
        timed = [m for m in methods if "failed" not in rows[m.name] and not m.is_slow]
        for method_name, rates in _rates(timed, middle, folder, rounds).items():
            rows[method_name] |= rates
    return rows


def _guarded(method: Method, measure: Callable[[], Row]) -> Row:
    row: Row = {"family": method.family, "access": method.access, "is_ours": method.is_ours}
    try:
        return row | measure()
    except NotRunError as error:
        return row | {"failed": str(error), "kind": "not run"}
    except NotPossibleError as error:
        return row | {"failed": str(error), "kind": "not possible"}
    except Exception as error:  # the methods after it are measured nevertheless
        traceback.print_exc()
        return row | {"failed": f"{type(error).__name__}: {error}", "kind": "error"}


def _quality(method: Method, voxels: Voxels, folder: Path) -> Row:
    with TemporaryDirectory(dir=folder) as name:
        calls = method.ready(voxels, Path(name))
        began = _measure.processor_seconds()
        code = calls.encode()
        encoded = _measure.processor_seconds()
        decoded = calls.decode(code)
        ended = _measure.processor_seconds()
        row = _figures(method, voxels, calls.voxels(decoded), calls.sizes(code))
    if method.is_slow:
        row |= _rate_row(voxels, encoded - began, ended - encoded)
    return row


def _figures(method: Method, voxels: Voxels, shown: Voxels, sizes: tuple[int, int]) -> Row:
    errors, reach = metrics.compare(voxels, shown), value_range(voxels)
    resident, disk = (8 * nbytes / voxels.size for nbytes in sizes)
    is_lossless = float(errors.max_abs) == 0
    return {
        "resident_bits": resident,
        "disk_bits": disk,
        "is_sampled": method.access in RESIDENT_ACCESS,
        "is_lossless": is_lossless,
        "psnr_db": None if is_lossless else errors.psnr(reach),
        "max_error_percent": 100 * float(errors.max_abs) / reach,
    }


def _rates(methods: Sequence[Method], voxels: Voxels, folder: Path, rounds: int) -> dict[str, Row]:
    """Million voxels for each second of one processor; encoders take turns, then decoders."""
    ready: dict[str, tuple[Calls, Any]] = {}
    with TemporaryDirectory(dir=folder) as name:
        for k, method in enumerate(methods):
            place = Path(name) / str(k)
            place.mkdir()
            # A part of a volume may have too few voxels for its rate; then it has no time.
            with suppress(NotPossibleError):
                calls = method.ready(voxels, place)
                ready[method.name] = calls, calls.encode()
        encoding = _measure.alternating(
            {k: calls.encode for k, (calls, _) in ready.items()}, rounds
        )
        decoding = _measure.alternating(
            {k: lambda c=calls, d=code: c.decode(d) for k, (calls, code) in ready.items()},  # type: ignore[misc]
            rounds,
            _measure.processor_seconds,
        )
    return {k: _rate_row(voxels, encoding[k], decoding[k]) for k in ready}


def _rate_row(voxels: Voxels, encode_seconds: float, decode_seconds: float) -> Row:
    return {
        "encode_mvoxels_per_second": voxels.size / 1e6 / encode_seconds,
        "decode_mvoxels_per_second": voxels.size / 1e6 / decode_seconds,
    }
