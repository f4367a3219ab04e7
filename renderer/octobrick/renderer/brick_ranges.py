"""What values the samples of each brick can have, and of cubes of bricks: the tree for culling.

Stored ranges are those of the originals, one voxel wider than the brick. What is interpolated are
*decoded* voxels, perhaps deblocked; so ranges are widened by what either may have moved.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.brick_source import BrickSource

KEPT: Final = 16
"""Tables kept for later views, by volume, level, time step and channel; 10⁶ bricks take 21 MB."""

Doubles = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BrickRanges:
    """Values by cube of 2^k bricks: entry k of each list is (nz, ny, nx).

    Attributes:
        lows: lowest value of any brick of the cube.
        highs: highest value of any.
        common_lows: highest of the bricks' lowest values: what lies from there to `common_highs`
            is in the range of every brick; nothing does where it is above.
        common_highs: lowest of the bricks' highest values.
    """

    lows: tuple[Doubles, ...]
    highs: tuple[Doubles, ...]
    common_lows: tuple[Doubles, ...]
    common_highs: tuple[Doubles, ...]

    @classmethod
    def of_bricks(cls, low: Doubles, high: Doubles) -> BrickRanges:
        """The tree above the ranges of bricks, up to a single cube."""
        return cls(
            _cubes(low, np.minimum, np.inf),
            _cubes(high, np.maximum, -np.inf),
            _cubes(low, np.maximum, -np.inf),
            _cubes(high, np.minimum, np.inf),
        )


_kept: OrderedDict[tuple[Any, ...], BrickRanges] = OrderedDict()
_kept_errors: OrderedDict[tuple[str, int, int, int], NDArray[np.float32]] = OrderedDict()
_lock = Lock()


def brick_ranges(
    source: BrickSource, level: int, t: int, c: int, *, deblocked: bool = False
) -> BrickRanges:
    """Bounds of what interpolation between decoded voxels can give in each brick of a level.

    The last few are kept: bricks of one revision never change.
    """
    return _kept_tree(
        (source.revision, level, t, c, deblocked),
        lambda: _decoded_ranges(source, level, t, c, deblocked=deblocked),
    )


def luminance_ranges(
    source: BrickSource,
    level: int,
    t: int,
    channels: Sequence[int],
    weights: Sequence[float],
    *,
    deblocked: bool = False,
) -> BrickRanges:
    """Likewise of the sum of some channels, each times its weight, which is not negative."""

    def summed() -> tuple[Doubles, Doubles]:
        trees = [brick_ranges(source, level, t, c, deblocked=deblocked) for c in channels]
        low = sum(w * tree.lows[0] for w, tree in zip(weights, trees, strict=True))
        high = sum(w * tree.highs[0] for w, tree in zip(weights, trees, strict=True))
        return np.asarray(low), np.asarray(high)

    key = (source.revision, level, t, *channels, *weights, deblocked)
    return _kept_tree(key, summed)


def _kept_tree(key: tuple[Any, ...], bricks: Callable[[], tuple[Doubles, Doubles]]) -> BrickRanges:
    """The tree that has been kept, or one above the ranges of bricks."""
    with _lock:
        if key in _kept:
            _kept.move_to_end(key)
            return _kept[key]
    tree = BrickRanges.of_bricks(*bricks())
    with _lock:
        _kept[key] = tree
        while len(_kept) > KEPT:
            _kept.popitem(last=False)
    return tree


def brick_errors(source: BrickSource, level: int, t: int, c: int) -> NDArray[np.float32]:
    """The largest error of each brick of a level (nz, ny, nx), kept as `brick_ranges` are."""
    key = (source.revision, level, t, c)
    with _lock:
        if key in _kept_errors:
            _kept_errors.move_to_end(key)
            return _kept_errors[key]
    errors = np.asarray(source.fidelity(level, t, c))[..., 0].astype(np.float32)
    with _lock:
        _kept_errors[key] = errors
        while len(_kept_errors) > KEPT:
            _kept_errors.popitem(last=False)
    return errors


def _decoded_ranges(
    source: BrickSource, level: int, t: int, c: int, *, deblocked: bool
) -> tuple[Doubles, Doubles]:
    """A brick's own voxels stay within its range but for the codec's error.

    The one voxel beyond was decoded from another brick and may be off by that brick's error. The
    deblocking filter stays within the voxels of the blocks that it joins, of this brick and of
    its neighbours.
    """
    ranges = np.asarray(source.ranges(level, t, c), dtype=np.float64)
    errors = np.asarray(source.fidelity(level, t, c), dtype=np.float64)[..., 0]
    slack = _of_neighbourhood(errors, np.maximum)
    low, high = ranges[..., 0] - slack, ranges[..., 1] + slack
    if deblocked:
        return _of_neighbourhood(low, np.minimum), _of_neighbourhood(high, np.maximum)
    return low, high


def _of_neighbourhood(values: Doubles, extreme: np.ufunc) -> Doubles:
    """The least or greatest of each cell and its 26 neighbours."""
    for axis in range(3):
        first, last = [slice(None)] * 3, [slice(None)] * 3
        first[axis], last[axis] = slice(None, -1), slice(1, None)
        lower, upper = values[tuple(first)], values[tuple(last)]
        values = values.copy()
        extreme(values[tuple(first)], upper, out=values[tuple(first)])
        extreme(values[tuple(last)], lower, out=values[tuple(last)])
    return values


def _cubes(values: Doubles, extreme: np.ufunc, beyond: float) -> tuple[Doubles, ...]:
    """Those of bricks, and the least or greatest in each cube of 2^k bricks, up to a single one."""
    found = [values]
    while max(found[-1].shape) > 1:
        found.append(_halved(found[-1], extreme, beyond))
    return tuple(found)


def _halved(values: Doubles, extreme: np.ufunc, beyond: float) -> Doubles:
    """The least or greatest of each cube of 2³, of what there is of it."""
    pad = [(0, n % 2) for n in values.shape]
    even = np.pad(values, pad, constant_values=beyond)
    z, y, x = (n // 2 for n in even.shape)
    cubes = even.reshape(z, 2, y, 2, x, 2)
    result: NDArray[Any] = extreme.reduce(cubes, axis=(1, 3, 5))
    return result
