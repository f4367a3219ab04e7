"""How a volume is stored, checked before anything is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import InvalidInputError
from octobrick.store import attributes as attrs
from octobrick.store.box import Box, Zyx
from octobrick.store.brick_codec import BrickCodec, codec_text, codec_to_json, require_codec
from octobrick.store.rate_target import Dial, RateTarget
from octobrick.store.reducers import REDUCERS
from octobrick.store.sources import Source
from octobrick.store.surface.option import SurfaceOption
from octobrick.store.surface.selection import SurfaceSelection

DEFAULT_CODEC = S3dc(block=(8, 8, 8), bits=4)
_ZSTD_OF_VOXELS, _ZSTD_OF_CODES = 3, 1


@dataclass(frozen=True, slots=True)
class IngestOptions:
    """The options of `ingest` that change what is stored, and how many work on it.

    Raises:
        InvalidInputError: naming the option, its value and what it may be.
        UnsupportedError: a codec whose codes volumes cannot hold.
    """

    codec: BrickCodec | Sequence[BrickCodec]
    psnr: float | None
    ratio: float | None
    brick: int
    shard: int
    zstd_level: int | None
    levels: int | None
    reducer: str | None
    gradients: bool
    labels: bool | None
    convert: str | None
    window: tuple[float, float] | None
    region: Box | None
    replace_nonfinite: float | None
    workers: int | None
    memory_nbytes: int | None
    checkpoint_seconds: float
    surface: SurfaceOption | None = None

    def __post_init__(self) -> None:
        for codec in self._given_codecs:
            require_codec(codec)
        if self.target is not None:
            _ = self.dial
        if self.surface is not None and (self.target is not None or self.gradients):
            raise InvalidInputError(
                f"surface: {self.target or 'gradients'} are of whole volumes; leave one of them out"
            )
        _require("brick", self.brick, attrs.BRICK_MIN, attrs.BRICK_MAX)
        if self.brick % 2:
            raise InvalidInputError(f"brick {self.brick}: must be even", brick=self.brick)
        _require("shard", self.shard, 1, attrs.SHARD_BRICKS_MAX)
        if self.zstd_level is not None:
            _require("zstd_level", self.zstd_level, 1, 19)
        if self.levels is not None:
            _require("levels", self.levels, 1, attrs.LEVELS_MAX)
        if self.reducer is not None and self.reducer not in REDUCERS:
            raise InvalidInputError(
                f"reducer {self.reducer!r}: must be one of {', '.join(REDUCERS)}",
                reducer=self.reducer,
            )
        if self.workers is not None:
            _require("workers", self.workers, 1, 1024)
        if self.replace_nonfinite is not None and not np.isfinite(self.replace_nonfinite):
            raise InvalidInputError(f"replace_nonfinite {self.replace_nonfinite}: must be finite")
        if self.memory_nbytes is not None and self.memory_nbytes < 1:
            raise InvalidInputError(f"memory {self.memory_nbytes}: must be a number of bytes")
        if not self.checkpoint_seconds >= 0:
            raise InvalidInputError(
                f"checkpoint_seconds {self.checkpoint_seconds}: must be 0 or more"
            )

    @property
    def target(self) -> RateTarget | None:
        """The PSNR or ratio for which codecs are to be found; None where these are given."""
        return RateTarget.of(self.psnr, self.ratio)

    @property
    def dial(self) -> Dial:
        """Where codecs for the target are looked for."""
        return Dial.of(self.codec, is_default=self.codec is DEFAULT_CODEC)

    def zstd_level_of(self, codec: BrickCodec) -> int:
        """The effort of zstd behind a codec.

        By default little where it has a code to work on, of which more effort makes a fiftieth at
        best, and thrice as much time: docs/performance.md.
        """
        return self.zstd_level or default_zstd_level(codec)

    @property
    def zstd_level_of_gradients(self) -> int:
        """The same for directions of gradients."""
        return self.zstd_level or _ZSTD_OF_CODES

    def reducer_of(self, source: Source) -> str:
        """What makes the coarser levels: as asked, else the mode of labels and the mean."""
        return self.reducer or ("mode" if self.has_labels(source) else "mean")

    def levels_of(self, source: Source) -> int | None:
        """How many levels: one of a light field, since a coarser one would mix its views.

        Raises:
            InvalidInputError: several were asked for of a light field.
        """
        if source.light_field is None:
            return self.levels
        if self.levels not in (None, 1):
            raise InvalidInputError(
                f"{source.path}: a light field has one level, but {self.levels} are asked for; "
                "leave the option out",
                path=str(source.path),
            )
        return 1

    def codecs_of(self, source: Source, nlevels: int) -> tuple[BrickCodec, ...]:
        """The bricks' code at each level: as asked, else labels are kept exactly.

        Raises:
            InvalidInputError: more codecs than levels; a lossy codec was asked for, but a label
                has no neighbours; or one with a codebook or background of another sample type.
            UnsupportedError: a codec cannot code the source's sample type.
        """
        given = self._given_codecs
        if source.light_field is not None and self.codec is DEFAULT_CODEC:
            given = (Zerobit(),)
        if len(given) > nlevels:
            raise InvalidInputError(
                f"{len(given)} codecs, but {nlevels} levels; give one for all or one for each"
            )
        if self.has_labels(source):
            if self.target is not None:
                raise InvalidInputError(
                    f"{source.path}: labels are stored exactly, so {self.target} cannot be had; "
                    "leave it out, or say that these voxels are quantities (labels=False)",
                    path=str(source.path),
                )
            if self.codec is DEFAULT_CODEC:
                return (None,) * nlevels
            for codec in given:
                _require_exact(codec, source)
        for codec in given:
            require_codec(codec, source.dtype)
        return given + (given[-1],) * (nlevels - len(given))

    @property
    def _given_codecs(self) -> tuple[BrickCodec, ...]:
        given = tuple(self.codec) if isinstance(self.codec, Sequence) else (self.codec,)
        if not given:
            raise InvalidInputError("no codec; give one for all levels or one for each, or None")
        if self.surface is None:
            return given
        if self.codec is DEFAULT_CODEC:
            given = (Zerobit(),)
        return tuple(map(self.surface.codec_of, given))

    def selection_of(self, source: Source, shapes_zyx: Sequence[Zyx]) -> SurfaceSelection | None:
        """The cells that are kept; None for all.

        Raises:
            InvalidInputError: the surface touches none, or lies too far away.
        """
        if self.surface is None:
            return None
        return self.surface.selection(shapes_zyx, source.spacing_zyx, self.brick)

    def has_labels(self, source: Source) -> bool:
        """Whether voxels are names rather than quantities."""
        return source.labels if self.labels is None else self.labels

    def to_json(self) -> dict[str, Any]:
        """Everything that the bytes of a volume depend on, beside its source."""
        region = self.region and [list(self.region.start_zyx), list(self.region.stop_zyx)]
        return {
            "codec": [codec_to_json(codec) for codec in self._given_codecs],
            "psnr": self.psnr,
            "ratio": self.ratio,
            "brick": self.brick,
            "shard": self.shard,
            "zstd_level": self.zstd_level,
            "levels": self.levels,
            "reducer": self.reducer,
            "gradients": self.gradients,
            "labels": self.labels,
            "convert": self.convert,
            "window": self.window and list(self.window),
            "region": region,
            "replace_nonfinite": self.replace_nonfinite,
        } | ({} if self.surface is None else {"surface": self.surface.to_json()})


def default_zstd_level(codec: BrickCodec) -> int:
    """The effort of zstd behind a codec where nobody asks for another."""
    return _ZSTD_OF_VOXELS if codec is None else _ZSTD_OF_CODES


def _require_exact(codec: BrickCodec, source: Source) -> None:
    if codec is not None:
        raise InvalidInputError(
            f"{source.path}: labels are stored exactly, not by {codec_text(codec)}; choose "
            "lossless, or say that these voxels are quantities (labels=False)",
            path=str(source.path),
        )


def _require(name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise InvalidInputError(
            f"{name} {value}: must be {low} to {high}", option=name, value=value
        )
