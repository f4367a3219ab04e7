"""The ``octobrick`` attributes of a volume: built by ingest, checked word by word when read.

docs/spec/volume-format.md says what each field means.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np

from octobrick.codec import metrics
from octobrick.codec.errors import OctobrickError
from octobrick.store.box import Zyx, ceil_div
from octobrick.store.brick_codec import BrickCodec, codec_from_json, codec_to_json, require_codec
from octobrick.store.camera_grid import CameraGrid
from octobrick.store.errors import VolumeFormatError
from octobrick.store.reducers import REDUCERS
from octobrick.store.surface.attributes import SurfaceAttributes
from octobrick.store.zarr_chunk import SUPPORTED_DTYPES

FORMAT_VERSION = 1
# A reader allocates a brick and a shard index on the word of the metadata: these bound both.
BRICK_MIN, BRICK_MAX = 8, 256
SHARD_BRICKS_MAX = 64
LEVELS_MAX = 32
_DIGEST_NBYTES = 16
SIDE_MAX = 2**31 - 1
_EXPONENT_MAX = 512  # of a histogram

Number = int | float
Json = Any
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class LevelAttributes:
    """What is known of one level beside its voxels.

    ``psnr_db`` is None where nothing was lost, ``gradient_nbytes`` where no gradients are stored.
    """

    shape_zyx: Zyx
    codec: BrickCodec
    stored_nbytes: int
    max_error: Number
    rmse: float
    psnr_db: float | None
    gradient_nbytes: int | None

    def to_json(self, usual: BrickCodec) -> dict[str, Json]:
        """The level as JSON-ready values; its codec only where that is another than usual."""
        fields = {
            "shape": list(self.shape_zyx),
            "stored_nbytes": self.stored_nbytes,
            "max_error": self.max_error,
            "rmse": self.rmse,
            "psnr_db": self.psnr_db,
            "gradient_nbytes": self.gradient_nbytes,
        }
        return fields if self.codec == usual else fields | {"codec": codec_to_json(self.codec)}


@dataclass(frozen=True, slots=True)
class VolumeAttributes:
    """Everything that a volume says of itself beyond OME-NGFF."""

    dtype: str
    brick: int
    shard_bricks: int
    nt: int
    nc: int
    spacing_zyx: tuple[float, float, float]
    unit: str | None
    reducer: str
    levels: tuple[LevelAttributes, ...]
    value_range: tuple[Number, Number]
    window: tuple[Number, Number]
    histograms: tuple[metrics.Histogram, ...]
    source: Mapping[str, Json]
    light_field: CameraGrid | None = None
    surface: SurfaceAttributes | None = None

    @property
    def codec(self) -> BrickCodec:
        """What the bricks of level 0 are coded by."""
        return self.levels[0].codec

    def revision(self, manifest: Json) -> str:
        """The digest of these attributes and the manifest of the shards: of all the content."""
        return digest_of({"attributes": self.to_json(), "manifest": digest_of(manifest)})

    def to_json(self) -> dict[str, Json]:
        """The attributes, without the revision, as JSON-ready values."""
        fields = {
            "version": FORMAT_VERSION,
            "dtype": self.dtype,
            "brick": [self.brick] * 3,
            "shard": [self.shard_bricks] * 3,
            "codec": codec_to_json(self.codec),
            "timepoints": self.nt,
            "channels": self.nc,
            "spacing": list(self.spacing_zyx),
            "unit": self.unit,
            "reducer": self.reducer,
            "levels": [level.to_json(self.codec) for level in self.levels],
            "value_range": list(self.value_range),
            "window": list(self.window),
            "histograms": [_histogram_to_json(h) for h in self.histograms],
            "source": dict(self.source),
        }
        if self.light_field is not None:
            fields["light_field"] = self.light_field.to_json()
        if self.surface is not None:
            fields["surface"] = self.surface.to_json()
        return fields

    @classmethod
    def from_json(cls, fields: Json, where: str) -> VolumeAttributes:
        """Read and check attributes.

        Raises:
            VolumeFormatError: naming the field that is missing or makes no sense.
        """
        checked = _Fields(fields, where)
        checked.require_version()
        brick, shard = checked.cube("brick"), checked.cube("shard")
        if not (BRICK_MIN <= brick <= BRICK_MAX and brick % 2 == 0):
            raise checked.wrong("brick", f"even, {BRICK_MIN} to {BRICK_MAX}")
        if not 1 <= shard <= SHARD_BRICKS_MAX:
            raise checked.wrong("shard", f"1 to {SHARD_BRICKS_MAX}")
        dtype = checked.get("dtype", str)
        if dtype not in SUPPORTED_DTYPES:
            raise checked.wrong("dtype", f"one of {sorted(SUPPORTED_DTYPES)}")
        reducer = checked.get("reducer", str)
        if reducer not in REDUCERS:
            raise checked.wrong("reducer", f"one of {', '.join(REDUCERS)}")
        z, y, x = checked.numbers("spacing", 3)
        if not min(z, y, x) > 0:
            raise checked.wrong("spacing", "positive")
        return cls(
            dtype=dtype,
            brick=brick,
            shard_bricks=shard,
            nt=checked.count("timepoints"),
            nc=checked.count("channels"),
            spacing_zyx=(z, y, x),
            unit=checked.optional_text("unit"),
            reducer=reducer,
            levels=checked.levels(np.dtype(dtype)),
            value_range=cast("tuple[Number, Number]", tuple(checked.numbers("value_range", 2))),
            window=cast("tuple[Number, Number]", tuple(checked.numbers("window", 2))),
            histograms=checked.histograms(),
            source=checked.get("source", dict),
            light_field=checked.light_field(),
            surface=SurfaceAttributes.from_fields(fields, where),
        )


def digest_of(document: Json) -> str:
    """A digest of a JSON document that depends on its content only, not on its layout."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.blake2b(text.encode(), digest_size=_DIGEST_NBYTES).hexdigest()


def python_number(value: np.generic | Number) -> Number:
    """A sample value as the int or float that JSON can hold."""
    number = value.item() if isinstance(value, np.generic) else value
    return cast("Number", number)


def _histogram_to_json(histogram: metrics.Histogram) -> dict[str, Json]:
    return {
        "exponent": histogram.exponent,
        "first": histogram.first,
        "counts": histogram.counts.tolist(),
    }


class _Fields:
    """Typed access to untrusted attributes."""

    def __init__(self, fields: Json, where: str) -> None:
        self.where = where
        if not isinstance(fields, dict):
            raise VolumeFormatError(
                f"{where}: no octobrick attributes; this is not a volume made by octobrick ingest"
            )
        self._fields = fields

    def wrong(self, name: str, expected: str) -> VolumeFormatError:
        return VolumeFormatError(
            f"{self.where}: octobrick.{name} is {self._fields.get(name)!r:.80}, expected "
            f"{expected}; ingest the volume again",
            field=name,
        )

    def require_version(self) -> None:
        if self._fields.get("version") != FORMAT_VERSION:
            raise VolumeFormatError(
                f"{self.where}: format version {self._fields.get('version')!r:.20} is not "
                f"{FORMAT_VERSION}, the one that this octobrick reads; install another octobrick "
                "or ingest the volume again"
            )

    def get(self, name: str, kind: type[_T]) -> _T:
        value = self._fields.get(name)
        if type(value) is not kind:
            raise self.wrong(name, f"a JSON {kind.__name__}")
        return value

    def count(self, name: str) -> int:
        value = self.get(name, int)
        if not 1 <= value <= SIDE_MAX:
            raise self.wrong(name, f"1 to {SIDE_MAX}")
        return value

    def optional_text(self, name: str) -> str | None:
        return None if self._fields.get(name) is None else self.get(name, str)

    def numbers(self, name: str, count: int) -> list[Number]:
        value = self.get(name, list)
        if len(value) != count or not all(_is_finite_number(n) for n in value):
            raise self.wrong(name, f"{count} finite numbers")
        return value

    def cube(self, name: str) -> int:
        value = self.get(name, list)
        if len(value) != 3 or len(set(map(repr, value))) != 1 or type(value[0]) is not int:
            raise self.wrong(name, "three equal integers")
        return int(value[0])

    def _codec(self, value: Json, dtype: np.dtype[Any]) -> BrickCodec:
        try:
            return require_codec(codec_from_json(value), dtype)
        except OctobrickError as error:
            raise VolumeFormatError(f"{self.where}: {error.message}", field="codec") from error

    def levels(self, dtype: np.dtype[Any]) -> tuple[LevelAttributes, ...]:
        usual = self._codec(self.get("codec", dict), dtype)
        values = self.get("levels", list)
        if not 1 <= len(values) <= LEVELS_MAX:
            raise self.wrong("levels", f"1 to {LEVELS_MAX} of them")
        levels = tuple(self._level(value, usual, dtype) for value in values)
        for finer, coarser in itertools.pairwise(levels):
            if tuple(ceil_div(n, 2) for n in finer.shape_zyx) != coarser.shape_zyx:
                raise self.wrong("levels", "each level half of the one before, rounded up")
        return levels

    def _level(self, value: Json, usual: BrickCodec, dtype: np.dtype[Any]) -> LevelAttributes:
        match value:
            case {
                "shape": [int(z), int(y), int(x)],
                "stored_nbytes": int(stored_nbytes),
                "max_error": max_error,
                "rmse": rmse,
                "psnr_db": psnr_db,
                "gradient_nbytes": gradient_nbytes,
            } if (
                all(1 <= n <= SIDE_MAX for n in (z, y, x))
                and _is_finite_number(max_error)
                and _is_finite_number(rmse)
                and (psnr_db is None or _is_finite_number(psnr_db))
                and (gradient_nbytes is None or type(gradient_nbytes) is int)
            ):
                own = self._codec(value["codec"], dtype) if "codec" in value else usual
                return LevelAttributes(
                    (z, y, x), own, stored_nbytes, max_error, rmse, psnr_db, gradient_nbytes
                )
        raise self.wrong(
            "levels", "shape, stored_nbytes, max_error, rmse, psnr_db and gradient_nbytes of each"
        )

    def light_field(self) -> CameraGrid | None:
        """The cameras whose views the slices are, if there are so many slices."""
        value = self._fields.get("light_field")
        if value is None:
            return None
        try:
            grid = CameraGrid.from_json(value)
        except OctobrickError as error:
            raise VolumeFormatError(
                f"{self.where}: octobrick.light_field: {error.message}; ingest the volume again",
                field="light_field",
            ) from error
        shapes = [level["shape"] for level in self.get("levels", list)]
        if len(shapes) != 1 or shapes[0][0] != grid.nslices or self.count("timepoints") != 1:
            raise self.wrong(
                "light_field",
                f"the views of one level and one time step, of {shapes[0][0]} slices, not "
                f"{grid.nslices}",
            )
        return grid

    def histograms(self) -> tuple[metrics.Histogram, ...]:
        values = self.get("histograms", list)
        if len(values) != self.count("channels"):
            raise self.wrong("histograms", "one of each channel")
        return tuple(self._histogram(value) for value in values)

    def _histogram(self, value: Json) -> metrics.Histogram:
        match value:
            case {"exponent": int(exponent), "first": int(first), "counts": list(counts)} if (
                abs(exponent) <= _EXPONENT_MAX
                and abs(first) < 2**53
                and len(counts) <= metrics.BINS_MAX
                and all(type(n) is int and 0 <= n < 2**63 for n in counts)
            ):
                return metrics.Histogram(exponent, first, np.array(counts, np.uint64))
        raise self.wrong("histograms", "exponent, first and counts of each")


def _is_finite_number(value: Json) -> bool:
    return type(value) in (int, float) and math.isfinite(value)
