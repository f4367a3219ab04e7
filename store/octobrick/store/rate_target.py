"""What a user asks of the size or the quality of a volume, and the codecs that can give it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import InvalidInputError
from octobrick.store.brick_codec import BrickCodec, codec_text

_BLOCK = (4, 4, 4)  # with a width per block, small ones cost little and gain much
LEAST_SHARE = 1e-5  # of zerobit's details: two of a brick of 64³
# Of S3Dc's slope, in squares of the peak: nothing is worth a bit, and every bit is.
STEEPEST, FLATTEST = 2.0**10, 2.0**-54


@dataclass(frozen=True, slots=True)
class RateTarget:
    """A PSNR or a compression ratio that every level is to have.

    Args:
        kind: which of both.
        value: in dB, with the level's greatest less its least voxel as peak; or bytes of the
            voxels over bytes on disk.

    Raises:
        InvalidInputError: a value that makes no sense.
    """

    kind: Literal["psnr", "ratio"]
    value: float

    def __post_init__(self) -> None:
        sound = math.isfinite(self.value) and self.value > 0
        if self.kind == "ratio":
            sound = sound and self.value >= 1
        if not sound:
            least = "above 0" if self.kind == "psnr" else "1 or more"
            raise InvalidInputError(f"{self.kind} {self.value}: must be a number, {least}")

    @classmethod
    def of(cls, psnr: float | None, ratio: float | None) -> RateTarget | None:
        """The one of both that was given, or none.

        Raises:
            InvalidInputError: both were given, or a value makes no sense.
        """
        if psnr is not None and ratio is not None:
            raise InvalidInputError(f"psnr {psnr} and ratio {ratio}: give one of them")
        if psnr is not None:
            return cls("psnr", float(psnr))
        return None if ratio is None else cls("ratio", float(ratio))

    def __str__(self) -> str:
        return f"{self.value:g} dB" if self.kind == "psnr" else f"ratio {self.value:g}"


@dataclass(frozen=True, slots=True)
class Dial:
    """A family of codecs, from the coarsest at 0 to the finest at 1.

    Args:
        template: says which family, and everything but the rate.
    """

    template: S3dc | Zerobit

    @classmethod
    def of(cls, codec: object, *, is_default: bool) -> Dial:
        """The dial that `ingest` turns where it was given this codec and a target.

        Args:
            codec: what was given.
            is_default: whether nobody asked for it.

        Raises:
            InvalidInputError: a codec that says its rate itself, or has none.
        """
        if is_default:
            codec = S3dc(_BLOCK)
        if isinstance(codec, S3dc):
            plain = codec == S3dc(codec.block)
        elif isinstance(codec, Zerobit):
            plain = codec.ratio == Zerobit().ratio
        else:
            plain = False
        if not plain or not isinstance(codec, S3dc | Zerobit):
            name = (
                codec_text(codec) if codec is None or isinstance(codec, S3dc | Zerobit) else codec
            )
            raise InvalidInputError(
                f"codec {name!s:.80} and a PSNR or ratio exclude each other: give S3dc(block) or "
                "Zerobit() without a rate, which is then found"
            )
        dial = cls(codec)
        dial.at(0.5, 1.0)  # refuses blocks that cannot have a width each
        return dial

    def at(self, position: float, peak: float) -> BrickCodec:
        """The codec at a position from 0 to 1, for a level with this peak, above 0."""
        if isinstance(self.template, Zerobit):
            share = LEAST_SHARE ** (1 - position) if position > 0 else 0.0
            return dataclasses.replace(self.template, ratio=_rounded(share))
        slope = peak * peak * STEEPEST * (FLATTEST / STEEPEST) ** position
        return S3dc(self.template.block, slope=_rounded(slope))

    @property
    def exact(self) -> tuple[BrickCodec, ...]:
        """Codecs that lose nothing, of which one can be the smaller."""
        block: Any = self.template.block if isinstance(self.template, S3dc) else _BLOCK
        return (S3dc(block, max_error=0), None)


def _rounded(value: float) -> float:
    """Five digits: what is stored and printed is what was measured."""
    return float(f"{value:.5g}")
