"""Errors of the store: what a source, a destination or a stored volume can get wrong."""

from __future__ import annotations

from octobrick.codec.errors import (
    ConflictError,
    CorruptDataError,
    NotFoundError,
    ResourceError,
    UnsupportedError,
)


class SourceError(CorruptDataError):
    """A source file is damaged, or its header does not describe its voxels."""

    kind = "corrupt-source"


class TruncatedSourceError(SourceError):
    """A source file ends before its last voxel: copy or export it again."""

    kind = "truncated-source"


class SourceNotFoundError(NotFoundError):
    """A source file, or the data file that its header names, does not exist."""

    kind = "source-not-found"


class UnsupportedSourceError(UnsupportedError):
    """A source file is sound, but of a kind that is not read: convert it first."""

    kind = "unsupported-source"


class SourceUnreachableError(ResourceError):
    """The server that holds a source does not answer, or refuses to: mend that, and run again."""

    kind = "source-unreachable"


class VolumeNotFoundError(NotFoundError):
    """There is no volume at this path: check the path, or ingest one."""

    kind = "volume-not-found"


class VolumeFormatError(CorruptDataError):
    """A volume's metadata or shard index is not what ingest wrote: restore or ingest again."""

    kind = "corrupt-volume"


class ServerUnreachableError(ResourceError):
    """The server of a volume does not answer, or answers nonsense: mend that, and try again."""

    kind = "server-unreachable"


class RevisionGoneError(NotFoundError):
    """The volume was replaced since it was opened, or its address learned: open it anew."""

    kind = "revision-gone"


class BrickStreamError(CorruptDataError):
    """A stream of bricks is not what a server writes, or was cut off: ask for the rest again."""

    kind = "corrupt-stream"


class IncompleteVolumeError(ConflictError):
    """An ingest into this path did not finish, or still runs: run it again, or wait."""

    kind = "incomplete-volume"


class DestinationExistsError(ConflictError):
    """Something is already at the destination: choose another or allow it to be overwritten."""

    kind = "destination-exists"


class DestinationBusyError(ConflictError):
    """Another ingest is writing this destination: wait for it or choose another."""

    kind = "destination-busy"


class DestinationError(ResourceError):
    """The system refuses to write the destination (space, permissions): make room or choose."""

    kind = "destination"


class ResumeError(ConflictError):
    """An unfinished ingest here was made from another source or with other options."""

    kind = "cannot-resume"


class IngestCancelledError(ConflictError):
    """An ingest was cancelled before its end: run it again to go on."""

    kind = "cancelled"


class SourceMismatchError(ConflictError):
    """A source is not the one that a volume was made from: give that one, or ingest again."""

    kind = "source-mismatch"
