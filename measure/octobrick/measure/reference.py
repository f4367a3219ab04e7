"""What is measured: a source, or a volume, as an ingest would store its voxels."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from octobrick.codec.errors import InvalidInputError
from octobrick.measure.options import SourceOptions
from octobrick.measure.volume_source import VolumeSource
from octobrick.store import Volume, open_volume
from octobrick.store.brick_codec import codec_text
from octobrick.store.opening import is_volume
from octobrick.store.sources import Source, open_source
from octobrick.store.sources.converted import converted
from octobrick.store.sources.location import is_url, location_of

# What a name ends with that says the format; of two, such as .nii.gz, both go.
_SUFFIX = re.compile(r"(\.[A-Za-z][A-Za-z0-9]{0,6}){1,2}$")
_NO_NAME = re.compile(r"[^A-Za-z0-9._-]+")


@dataclass(frozen=True, slots=True)
class Reference:
    """Voxels that codes are compared with.

    Attributes:
        source: gives them, of the type in which they are stored.
        given: how the caller named it.
        options: how it was read.
        volume: where it is one of ours; None for a source.
    """

    source: Source
    given: str
    options: SourceOptions
    volume: Volume | None

    @property
    def labels(self) -> bool:
        """Whether voxels are names, which an ingest keeps exactly."""
        return self.source.labels if self.options.labels is None else self.options.labels

    @property
    def name(self) -> str:
        """For files that are made of it, without what says the format."""
        name = _SUFFIX.sub("", self.source.path.name.rstrip("/"))
        return _NO_NAME.sub("_", name).strip("._-") or "volume"

    def describe(self) -> dict[str, Any]:
        """What it is, JSON-ready; of a lossy volume what it has lost already."""
        volume = self.volume
        facts: dict[str, Any] = self.source.describe() | {"name": self.name, "labels": self.labels}
        if volume is None:
            return facts | {"stored": None}
        level = volume.levels[0]
        return facts | {
            "stored": {
                "revision": volume.revision,
                "codec": codec_text(volume.codec),
                "lossless": level.max_error == 0,
                "psnr_db": level.psnr_db,
                "max_error": level.max_error,
                "rmse": level.rmse,
                "stored_nbytes": level.stored_nbytes,
            }
        }


@contextlib.contextmanager
def open_reference(path: str, options: SourceOptions) -> Iterator[Reference]:
    """A source or a volume, open for the block.

    Raises:
        What `open_source` and `open_volume` raise, and InvalidInputError where the options of a
        source are given for a volume.
    """
    if is_volume(path):
        _refuse_options(path, options)
        # A folder has no token, and a server's comes from the environment.
        volume = open_volume(path)
        source: Source = VolumeSource(location_of(path), volume)
    else:
        volume = None
        source = open_source(
            path,
            shape_zyx=options.shape,
            dtype=options.dtype,
            spacing_zyx=options.spacing,
            offset_nbytes=options.offset,
            big_endian=options.big_endian,
            dataset=options.dataset,
            axes=options.axes,
        )
    with source:
        yield Reference(converted(source, options.convert, options.window), path, options, volume)


def ingestible(reference: Reference) -> str:
    """How `octobrick ingest` is told of the same voxels.

    A server gives a volume's voxels to other programs at another address than to ours.
    """
    given = reference.given
    if reference.volume is not None and is_url(given):
        return re.sub(r"/v1/volumes/([^/]+)/?$", r"/zarr/\1", given)
    return given


def _refuse_options(path: str, options: SourceOptions) -> None:
    given = [flag for flag in options.given() if flag not in ("--labels", "--no-labels")]
    if given:
        raise InvalidInputError(
            f"{path}: a volume says itself what it holds; leave out {', '.join(given)}", path=path
        )
