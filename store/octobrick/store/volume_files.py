"""The JSON files of a volume, read with a limit, and what their absence means."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from octobrick.store.destination import partial_path
from octobrick.store.errors import (
    IncompleteVolumeError,
    VolumeFormatError,
    VolumeNotFoundError,
)
from octobrick.store.layout import MANIFEST_NAME, METADATA_NBYTES_MAX


def shard_entries(manifest: Any, path: Path) -> dict[str, tuple[int, str]]:
    """Size and digest of every shard in a manifest, by its path below the volume.

    Raises:
        VolumeFormatError: it is no manifest.
    """
    try:
        return {
            str(name): (int(entry["nbytes"]), str(entry["xxh3_128"]))
            for name, entry in manifest["shards"].items()
        }
    except (AttributeError, KeyError, TypeError, ValueError):
        raise VolumeFormatError(
            f"{path / MANIFEST_NAME}: not a manifest of shards; restore the file or ingest the "
            "volume again",
            path=str(path),
        ) from None


def read_json(file: Path, volume: Path) -> Any:
    """The content of a file of a volume.

    Raises:
        VolumeNotFoundError, IncompleteVolumeError: it is not there, because no volume is.
        VolumeFormatError: it is missing alone, too large, or no JSON.
    """
    try:
        if file.stat().st_size > METADATA_NBYTES_MAX:
            raise VolumeFormatError(
                f"{file}: {file.stat().st_size} bytes of metadata, at most "
                f"{METADATA_NBYTES_MAX} are read",
                path=str(volume),
            )
        return json.loads(file.read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        raise _explain_absence(file, volume) from None
    except (ValueError, RecursionError) as error:
        raise VolumeFormatError(
            f"{file}: not valid JSON ({error}); restore the file or ingest the volume again",
            path=str(volume),
        ) from error


def _explain_absence(file: Path, volume: Path) -> Exception:
    if partial_path(volume).is_dir() and not volume.exists():
        return IncompleteVolumeError(
            f"{volume}: incomplete, an ingest into it did not finish or still runs; wait for it, "
            "or run it again",
            path=str(volume),
        )
    if not volume.exists():
        return VolumeNotFoundError(
            f"{volume}: no such volume; check the path, or make one with `octobrick ingest`",
            path=str(volume),
        )
    return VolumeFormatError(
        f"{volume}: {file.name} is missing, so this is no volume of octobrick; make one with "
        "`octobrick ingest`",
        path=str(volume),
    )
