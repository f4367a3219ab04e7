"""Opening a volume, wherever it is."""

from __future__ import annotations

import os
from pathlib import Path
from typing import overload

from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.store.destination import partial_path
from octobrick.store.http_address import is_volume_address
from octobrick.store.layout import MANIFEST_NAME
from octobrick.store.local_volume import LocalVolume
from octobrick.store.sources.location import is_url
from octobrick.store.volume import Volume


@overload
def open_volume(path: os.PathLike[str]) -> LocalVolume: ...


@overload
def open_volume(path: str | os.PathLike[str], *, token: str | None = None) -> Volume: ...


def open_volume(path: str | os.PathLike[str], *, token: str | None = None) -> Volume:
    """Open a volume that ``ingest`` wrote, in a folder or on a server.

    Args:
        path: a folder, or ``http://host/v1/volumes/ID`` of an octobrick server.
        token: lets into that server; by default what ``OCTOBRICK_TOKEN`` holds. Sent nowhere else.

    Raises:
        VolumeNotFoundError: there is nothing at the path.
        IncompleteVolumeError: an ingest into the path did not finish, or still runs.
        VolumeFormatError: what is there is no volume, or its metadata is damaged.
        ServerUnreachableError: the server does not answer, or with nonsense.
        InvalidInputError: an address that is not one of a volume; a token for a folder.
        ResourceError: the package that addresses need is not installed.
    """
    if isinstance(path, str) and is_url(path):
        from octobrick.store.http_volume import HttpVolume

        return HttpVolume(path, token=token)
    if token is not None:
        raise InvalidInputError("token: is for a server; a folder needs none")
    return LocalVolume(Path(path))


def is_volume(path: str | os.PathLike[str]) -> bool:
    """Whether a path is, or is named as, one of our volumes; another's Zarr is a source."""
    if isinstance(path, str) and is_url(path):
        return is_volume_address(path)
    folder = Path(path)
    if folder.is_dir():
        return (folder / MANIFEST_NAME).exists()
    return folder.suffix == ".zarr" or partial_path(folder).is_dir()


def open_local(path: str | os.PathLike[str]) -> LocalVolume:
    """Open a volume in a folder, for what needs its files.

    Raises:
        UnsupportedError: an address.
        VolumeNotFoundError, IncompleteVolumeError, VolumeFormatError: as `open_volume`.
    """
    if isinstance(path, str) and is_url(path):
        raise UnsupportedError(
            "a volume on a server cannot be checked or repaired from here, its files are needed; "
            "run this on the machine that has them"
        )
    return LocalVolume(Path(path))
