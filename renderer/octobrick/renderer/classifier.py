"""From stored voxels to colour: value scale, window and transfer function made into one table.

Three spaces of a sample: *stored* (0..1, what the slab texture holds), *value* (what the volume
means: HU, counts), *entry* (a position in the table). Each is a linear map of the one before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.renderer.modes import COMPOSITING, Isosurface, Mode, Projection, Slice
from octobrick.renderer.transfer_function import LARGEST, TransferFunction

TABLE_ENTRIES: Final = 4096
"""16 entries per value for 8-bit data, 64 KiB as RGBA32F: the caches of a core hold it."""
FLOAT32_SLACK: Final = 2.0**-21
"""By which share of its largest term the shader's position in the table can be off: a few units of
the last place, from the stored value, the product and the sum."""
NARROWEST: Final = 1e-9
"""A domain narrower than this share of the values in it is below what float32 tells apart."""


@dataclass(frozen=True, slots=True)
class ValueScale:
    """The values that a stored 0 and a stored 1 stand for."""

    lowest: float
    highest: float

    @classmethod
    def of(cls, dtype: np.dtype[Any], value_range: tuple[float, float]) -> ValueScale:
        """The whole range of an integer type; the volume's own range for float32.

        Raises:
            UnsupportedError: for any other type.
        """
        if dtype in (np.uint8, np.int8, np.uint16, np.int16):
            info = np.iinfo(dtype)
            return cls(float(info.min), float(info.max))
        if dtype == np.float32:
            return cls(float(value_range[0]), float(value_range[1]))
        raise UnsupportedError(
            f"the renderer takes uint8, int8, uint16, int16 and float32 voxels, not {dtype}; "
            "ingest the volume with one of these types",
            dtype=str(dtype),
        )

    @property
    def width(self) -> float:
        """Values from a stored 0 to a stored 1; 0 for a constant float volume."""
        return self.highest - self.lowest

    def to_stored(self, value: float) -> float:
        """Where a value lies in the texture; 0 for a constant volume, as the decoder stores it."""
        return (value - self.lowest) / self.width if self.width > 0 else 0.0


class Classifier:
    """A transfer function laid over a window, ready for the shader and for culling.

    Args:
        function: colour and opacity.
        scale: of the stored voxels.
        window: values at relative positions 0 and 1.
        step_ratio: length of a ray step in reference lengths, d/d0.
        mode: what rays make of their samples, which decides what of the function counts.
    """

    def __init__(
        self,
        function: TransferFunction,
        scale: ValueScale,
        window: tuple[float, float],
        step_ratio: float,
        mode: Mode = COMPOSITING,
    ) -> None:
        self.table = _table(function, step_ratio, mode)
        self.scale, self.window = scale, window
        self.mode = mode
        self._low, self._high = function.value_domain(window)
        largest = max(abs(scale.lowest), abs(scale.highest), abs(self._low), 1e-30)
        domain_width = max(self._high - self._low, NARROWEST * largest)
        self._entries_per_value = (TABLE_ENTRIES - 1) / domain_width
        self.entries_per_stored = scale.width * self._entries_per_value
        self.entry_of_stored_zero = (scale.lowest - self._low) * self._entries_per_value
        self.entry_margin = 1.0 + FLOAT32_SLACK * max(
            self.entries_per_stored, abs(self.entry_of_stored_zero)
        )
        """Entries by which a range is widened before it is looked up."""
        self.opaque_before = _count_before(self.table[:, 3] > 0)
        self._opaque_from = _next_set(self.table[:, 3] > 0)

    @property
    def empty(self) -> bool:
        """True where nothing can be seen, whatever the values."""
        return int(self.opaque_before[-1]) == 0

    @property
    def everything_counts(self) -> bool:
        """Whether every sample matters, whatever its value: for means, and planes of a slice."""
        return isinstance(self.mode, Slice) or self._statistic == "mean"

    @property
    def _statistic(self) -> str | None:
        return self.mode.statistic if isinstance(self.mode, Projection) else None

    @property
    def widened(self) -> tuple[bool, bool]:
        """Whether a range counts as if it reached to the least, and to the greatest value.

        A greatest value matters if it, or any less, is visible: else another is the greatest, or
        what is found is transparent. Likewise for the least.
        """
        return self._statistic == "max", self._statistic == "min"

    @property
    def surface_stored(self) -> tuple[float, float] | None:
        """Stored values around that of an isosurface, as far as float32 can be off; else None."""
        if not isinstance(self.mode, Isosurface):
            return None
        value = self.scale.to_stored(self.mode.value)
        slack = FLOAT32_SLACK * max(abs(value), 1.0)
        return value - slack, value + slack

    def visible(self, low: NDArray[Any], high: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether any value in [low, high] can be seen. Never misses one.

        The shader interpolates between table entries, so a range touches every entry from the one
        below its low end to the one above its high end.
        """
        if self.everything_counts:
            return np.full(np.shape(low), not self.empty)
        if self.surface_stored is not None:
            least, greatest = (
                self.scale.lowest + stored * self.scale.width for stored in self.surface_stored
            )
            return np.asarray((low <= greatest) & (high >= least))
        from_least, to_greatest = self.widened
        first: Any = 0
        if not from_least:
            first = _in_table(np.floor(self._entry(low) - self.entry_margin))
        sought = self._opaque_from.take(first)
        if to_greatest:
            return np.asarray(sought < np.inf)
        # The entry above the high end is at or beyond the one that is sought.
        return np.asarray(self._entry(high) + self.entry_margin > sought)

    def _entry(self, value: NDArray[Any]) -> NDArray[np.float64]:
        """The position in the table of a value, not clipped."""
        return (np.asarray(value, np.float64) - self._low) * self._entries_per_value


@lru_cache(maxsize=32)  # of 64 KiB: of a view at each of its levels
def _table(function: TransferFunction, step_ratio: float, mode: Mode) -> NDArray[np.float32]:
    """Premultiplied colour by entry, read-only: of a step, of the whole ray, or of a surface."""
    table = _new_table(function, step_ratio, mode)
    table.flags.writeable = False
    return table


def _new_table(function: TransferFunction, step_ratio: float, mode: Mode) -> NDArray[np.float32]:
    if isinstance(mode, Projection):
        return function.table(TABLE_ENTRIES)
    if isinstance(mode, Isosurface):
        return function.table(TABLE_ENTRIES, opacity=mode.opacity)
    if isinstance(mode, Slice):
        return function.table(TABLE_ENTRIES, opacity=1.0)
    return function.table(TABLE_ENTRIES, step_ratio)


def checked_window(
    window: tuple[float, float] | None, default: tuple[float, float]
) -> tuple[float, float]:
    """The caller's window, or the volume's own, widened where that has no width.

    Raises:
        InvalidInputError: the caller's window is not finite or not ascending.
    """
    if window is None:
        low, high = (float(bound) for bound in default)
        if low < high:
            return low, high
        width = max(1.0, abs(low) * 1e-6)
        return min(low, LARGEST - width), min(low + width, LARGEST)
    try:
        low, high = (float(bound) for bound in window)
    except (TypeError, ValueError):
        low = high = math.nan
    if not -LARGEST <= low < high <= LARGEST:
        raise InvalidInputError(
            f"window {window!r} must be two values that float32 has, the lower first; "
            f"the volume's own is {default}"
        )
    return low, high


def _in_table(entries: NDArray[np.float64]) -> NDArray[np.intp]:
    """The nearest entries that there are; np.clip takes twice as long for short arrays."""
    nearest = np.minimum(np.maximum(entries, 0), TABLE_ENTRIES - 1)
    return nearest.astype(np.intp)


def _next_set(flags: NDArray[np.bool_]) -> NDArray[np.float64]:
    """By position, that of the first flag that is set from there on, less one.

    A number is greater if that flag, or one behind it, is at the number rounded up. -inf for the
    first position, as that is where numbers below 0 are looked up; inf where no flag is set.
    """
    positions = np.where(flags, np.arange(len(flags), dtype=np.float64), np.inf)
    found: NDArray[np.float64] = np.minimum.accumulate(positions[::-1])[::-1] - 1
    found[found < 0] = -np.inf
    return found


def _count_before(flags: NDArray[np.bool_]) -> NDArray[np.uint32]:
    """How many flags are set before each position, and in all: (n + 1,)."""
    return np.concatenate([[0], np.cumsum(flags)]).astype(np.uint32)
