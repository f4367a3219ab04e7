"""Volumes that are many files: a folder, or a pattern such as ``run1/t*.nrrd``."""

from __future__ import annotations

import glob
import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from octobrick.codec.errors import ResourceError
from octobrick.store.errors import SourceError, SourceNotFoundError, UnsupportedSourceError
from octobrick.store.sources.head import read_head
from octobrick.store.sources.pictures import PICTURE_SUFFIXES

_DICOM_MAGIC = (128, b"DICM")
_QUOTED_FILES = 3


def is_several(path: Path) -> bool:
    """Whether a path is a folder, or a pattern and not the name of a file."""
    return path.is_dir() or (glob.has_magic(str(path)) and not path.exists())


def files_of(path: Path) -> list[Path]:
    """The files of a folder or pattern, ``a2`` before ``a10``; hidden ones are left out.

    Raises:
        SourceNotFoundError: there is none.
        ResourceError: the folder cannot be read.
    """
    if path.is_dir():
        try:
            with os.scandir(path) as entries:
                names = [
                    entry.path
                    for entry in entries
                    if entry.is_file() and not entry.name.startswith(".")
                ]
        except OSError as error:
            raise ResourceError(
                f"{path}: the folder cannot be read: {error.strerror}; check its permissions",
                path=str(path),
            ) from error
    else:
        found = glob.iglob(str(path), recursive=True)  # noqa: PTH207  (a pattern may be absolute)
        names = [name for name in found if Path(name).is_file()]
    if not names:
        raise SourceNotFoundError(
            f"{path}: the folder or pattern holds no file; check the name", path=str(path)
        )
    return [Path(name) for name in sorted(names, key=natural_key)]


def natural_key(name: str) -> tuple[list[tuple[int, int, str]], str]:
    """What sorts names as people count: digits as the number that they are."""
    parts = re.split(r"([0-9]+)", name)
    key = [(0, int(part), "") if part.isdecimal() else (1, 0, part.casefold()) for part in parts]
    return key, name


def pictures_of(path: Path, files: Sequence[Path]) -> tuple[list[Path], tuple[str, ...]]:
    """The pictures among the files, all of one kind, and a warning of what is left aside.

    Raises:
        UnsupportedSourceError: PNG beside JPEG, say: it is not clear which are meant.
    """
    pictures = [file for file in files if is_picture(file)]
    kinds = Counter(_kind(file) for file in pictures)
    if len(kinds) > 1:
        counted = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        raise UnsupportedSourceError(
            f"{path}: holds pictures of several kinds ({counted}); say which are the slices by a "
            f"pattern such as '{path / ('*' + pictures[0].suffix)}'",
            path=str(path),
        )
    others = [file.name for file in files if not is_picture(file)]
    if not others or not pictures:
        return pictures, ()
    return pictures, (_left_aside("pictures", others),)


def dicoms_of(path: Path, files: Sequence[Path]) -> tuple[list[Path], tuple[str, ...]]:
    """The DICOM files among the files, whatever their names, and a warning of what is left aside.

    Raises:
        UnsupportedSourceError: there are pictures beside them: it is not clear which are meant.
        SourceError: a file is none, but named as those that are, up to the numbers in its name.
    """
    dicoms = [file for file in files if not is_picture(file) and is_dicom(file)]
    if not dicoms or len(dicoms) == len(files):
        return dicoms, ()
    if any(is_picture(file) for file in files):
        raise UnsupportedSourceError(
            f"{path}: holds {len(dicoms)} DICOM files beside pictures; say which are meant by a "
            f"pattern such as '{path / ('*' + dicoms[0].suffix)}'",
            path=str(path),
        )
    known = set(dicoms)
    names = {_without_numbers(file) for file in dicoms}
    others = [file for file in files if file not in known]
    for file in others:
        if _without_numbers(file) in names:
            raise SourceError(
                f"{file}: does not begin as DICOM does, unlike {dicoms[0].name} beside it; "
                "copy it again or leave it out",
                path=str(file),
            )
    return dicoms, (_left_aside("DICOM", [file.name for file in others]),)


def _without_numbers(file: Path) -> str:
    return re.sub("[0-9]+", "0", file.name)


def _left_aside(kind: str, names: list[str]) -> str:
    quoted = ", ".join(names[:_QUOTED_FILES]) + (", ..." if len(names) > _QUOTED_FILES else "")
    return f"{len(names)} files that are no {kind} are left aside: {quoted}"


def is_picture(file: Path) -> bool:
    """Whether a file is named as a picture."""
    return file.suffix.lower() in PICTURE_SUFFIXES


def is_dicom(file: Path) -> bool:
    """Whether a file begins as DICOM files do."""
    offset, magic = _DICOM_MAGIC
    return read_head(file, offset + len(magic))[offset:] == magic


def refuse_folder(path: Path, files: Sequence[Path]) -> NoReturn:
    """Say what was looked for in a folder.

    Raises:
        UnsupportedSourceError: always.
    """
    # Descriptions beside raw files are no files of time steps.
    voxels = next((file for file in files if file.suffix.lower() != ".json"), files[0])
    ending = "".join(voxels.suffixes[-2 if voxels.suffix == ".gz" else -1 :])
    raise UnsupportedSourceError(
        f"{path}: is a folder of {len(files)} files, but none of them are pictures (PNG, JPEG, "
        f"TIFF) or DICOM; give one file, or the files of all time steps as a pattern such as "
        f"'{path / f'*{ending}'}'",
        path=str(path),
        files=len(files),
    )


def _kind(file: Path) -> str:
    return {".jpeg": ".jpg", ".tiff": ".tif"}.get(file.suffix.lower(), file.suffix.lower())
