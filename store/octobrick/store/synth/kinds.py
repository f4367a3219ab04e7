"""The kinds of procedural volumes by name, and any planes of them as samples of any type."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Zyx
from octobrick.store.synth.blocks import Blocks
from octobrick.store.synth.field import Field, Plane
from octobrick.store.synth.marschner_lobb import MarschnerLobb
from octobrick.store.synth.noise import FractalNoise
from octobrick.store.synth.spheres import Spheres
from octobrick.store.synth.textures import Marble, Wood

_FIELDS: dict[str, type[Field]] = {
    "marschner-lobb": MarschnerLobb,
    "fractal-noise": FractalNoise,
    "spheres": Spheres,
    "blocks": Blocks,
    "marble": Marble,
    "wood": Wood,
}
KINDS = tuple(_FIELDS)
SYNTH_DTYPES = ("uint8", "uint16", "int16", "float32")
RGB_KINDS = tuple(name for name, field in _FIELDS.items() if field.palette is not None)
SEED_MAX = 2**63 - 1


def planes(
    kind: str,
    shape: Sequence[int],
    dtype: DTypeLike,
    z0: int,
    z1: int,
    seed: int = 0,
    *,
    rgb: bool = False,
) -> NDArray[Any]:
    """Planes z0 up to but without z1 of a volume, equal to the same planes of the whole.

    Values from 0 to 1 are spread over the range of an integer type, and are kept for float32.

    Args:
        kind: one of ``KINDS``.
        shape: voxels of the whole volume along z, y and x.
        dtype: one of ``SYNTH_DTYPES``.
        z0: the first plane.
        z1: the plane behind the last.
        seed: chooses among the volumes of a kind.
        rgb: colours instead of scalars, for marble and wood.

    Returns:
        (z1 - z0, y, x), with ``rgb`` (z1 - z0, y, x, 3).

    Raises:
        InvalidInputError: naming the argument, its value and what it may be.
    """
    field = make_field(kind, shape, seed, rgb=rgb)
    sample_type = require_sample_type(dtype)
    if not 0 <= z0 < z1 <= field.shape_zyx[0]:
        raise InvalidInputError(
            f"planes {z0} to {z1}: 0 <= z0 < z1 <= {field.shape_zyx[0]} is expected", z0=z0, z1=z1
        )
    return field_planes(field, sample_type, z0, z1, rgb=rgb)


def make_field(kind: str, shape: Sequence[int], seed: int, *, rgb: bool = False) -> Field:
    """The field of a kind; raises what `planes` does."""
    if kind not in _FIELDS:
        raise InvalidInputError(f"{kind!r}: no such kind; there are {', '.join(KINDS)}", kind=kind)
    if rgb and kind not in RGB_KINDS:
        raise InvalidInputError(
            f"{kind}: has no colours; leave out rgb, or choose {' or '.join(RGB_KINDS)}", kind=kind
        )
    if not 0 <= seed <= SEED_MAX:
        raise InvalidInputError(f"seed {seed}: must be 0 to {SEED_MAX}", seed=seed)
    return _FIELDS[kind](_require_shape(shape), seed)


def require_sample_type(dtype: DTypeLike) -> np.dtype[Any]:
    """The sample type; raises `InvalidInputError` for one that is not made."""
    try:
        name = np.dtype(dtype).name
    except TypeError:
        name = str(dtype)
    if name not in SYNTH_DTYPES:
        raise InvalidInputError(
            f"dtype {name!r:.40}: must be one of {', '.join(SYNTH_DTYPES)}", dtype=name
        )
    return np.dtype(name)


def field_planes(
    field: Field, dtype: np.dtype[Any], z0: int, z1: int, *, rgb: bool
) -> NDArray[Any]:
    """Planes of a field that has been made already; what neighbours share is made once."""
    _, ny, nx = field.shape_zyx
    out = np.empty((z1 - z0, ny, nx, 3) if rgb else (z1 - z0, ny, nx), dtype)
    for z in range(z0, z1):
        values = field.plane(z)
        if rgb:
            assert field.palette is not None
            for channel in range(3):
                shade = _shaded(values, field.palette[:, channel])
                out[z - z0, :, :, channel] = _sampled(shade, dtype)
        else:
            out[z - z0] = _sampled(values, dtype)
    return out


def _require_shape(shape: Sequence[int]) -> Zyx:
    sizes = [int(n) for n in shape]
    if len(sizes) != 3 or min(sizes) < 1:
        raise InvalidInputError(
            f"shape {sizes[:8]}: three numbers of at least 1 in the order z, y, x are expected",
            shape_zyx=sizes[:8],
        )
    z, y, x = sizes
    return (z, y, x)


def _shaded(values: Plane, shades: NDArray[np.float32]) -> Plane:
    """The values looked up in a ramp of three shades."""
    dark, middle, bright = shades
    lower: Plane = np.minimum(values, np.float32(0.5)) * (2 * (middle - dark))
    upper = np.maximum(values, np.float32(0.5)) * (2 * (bright - middle))
    lower += upper
    lower += dark + middle - bright
    np.clip(lower, 0, 1, out=lower)
    return lower


def _sampled(values: Plane, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Values from 0 to 1 as samples, rounded half up; the plane is used up."""
    if dtype.kind == "f":
        return values
    limits = np.iinfo(dtype)
    values *= np.float32(limits.max - limits.min)
    values += np.float32(limits.min + 0.5)
    if limits.min < 0:
        np.floor(values, out=values)  # a cast cuts towards zero
    return values.astype(dtype)
