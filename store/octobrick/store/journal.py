"""What an ingest needs to go on after it was killed: one file, replaced at every checkpoint.

A checkpoint is a moment between two pieces of the source. It holds how far the source was read,
the planes that the pyramid still needs, what is known of the bricks so far, and of every shard
that is under way its length and index. Bytes written after it are cut off on resuming and written
again; as nothing depends on timing, they are the same.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from octobrick.store.errors import ResumeError
from octobrick.store.window import pieces_of

JOURNAL_NAME = ".journal"
_FACTS = "facts.json"
_VERSION = 2


class Planes(NamedTuple):
    """An array that need not be in memory as a whole."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    pieces: Callable[[], Iterator[NDArray[Any]]]
    """Gives it in pieces that follow each other in memory."""


Arrays = dict[str, NDArray[Any] | Planes]


class Journal:
    """The journal of one destination.

    Args:
        folder: in which the volume grows.
        inputs: what the volume is made from: fingerprint of the source and options, JSON-ready.
            Only an ingest with the same may go on.
    """

    def __init__(self, folder: Path, inputs: Mapping[str, Any]) -> None:
        self._path = folder / JOURNAL_NAME
        self._inputs = json.loads(json.dumps(inputs))

    def write(self, facts: Mapping[str, Any], arrays: Arrays) -> None:
        """Replace the checkpoint by this one; durable when it returns."""
        document = {"version": _VERSION, "inputs": self._inputs, "facts": facts}
        temporary = self._path.with_name(JOURNAL_NAME + ".part")
        with temporary.open("wb") as file:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
                archive.writestr(_FACTS, json.dumps(document))
                for name, array in arrays.items():
                    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                        _write_array(member, array)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(self._path)

    def read(self) -> Checkpoint | None:
        """The last checkpoint, to be closed; None where there is none that can be read.

        Raises:
            ResumeError: it is of an ingest from another source or with other options.
        """
        archive = None
        try:
            archive = zipfile.ZipFile(self._path)
            document = json.loads(archive.read(_FACTS))
            if document["version"] == _VERSION:
                self._require_same(document["inputs"])
                return Checkpoint(document["facts"], archive)
        except ResumeError:
            raise
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
            pass  # none yet, or damaged: the ingest starts again
        if archive is not None:
            archive.close()
        return None

    def _require_same(self, inputs: Mapping[str, Any]) -> None:
        if inputs == self._inputs:
            return
        changed = _differences(inputs, self._inputs)
        name, (before, now) = next(iter(changed.items()))
        raise ResumeError(
            f"{self._path.parent}: an ingest that did not finish was made from other input: {name} "
            f"was {before!r:.120} and is {now!r:.120}; run it as before to go on, or start anew "
            "(--restart)",
            path=str(self._path.parent),
            changed=sorted(changed),
        )


class Checkpoint:
    """What a journal held. Its arrays are read, and checked, as they are asked for.

    Attributes:
        facts: what was written.
    """

    def __init__(self, facts: dict[str, Any], archive: zipfile.ZipFile) -> None:
        self.facts = facts
        self._archive = archive

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._archive.close()

    def array(self, name: str) -> NDArray[Any]:
        """An array.

        Raises:
            KeyError, ValueError, BadZipFile: it is missing or damaged.
        """
        with self._archive.open(f"{name}.npy") as member:
            array: NDArray[Any] = np.lib.format.read_array(member, allow_pickle=False)
            member.read(1)  # the end, where the checksum is looked at
        return array

    def pieces(
        self, name: str, plane_shape: tuple[int, ...], dtype: np.dtype[Any]
    ) -> Iterator[tuple[int, int, NDArray[Any]]]:
        """An array in pieces of a bounded size: first plane, first row, and rows (z, y, …).

        Args:
            name: which.
            plane_shape: of the axes behind the first.
            dtype: sample type.

        Raises:
            KeyError, ValueError, BadZipFile: it is missing, damaged, or of another shape or type.
        """
        with self._archive.open(f"{name}.npy") as member:
            np.lib.format.read_magic(member)
            shape, fortran, found = np.lib.format.read_array_header_1_0(member)
            if shape[1:] != plane_shape or found != dtype or fortran:
                raise ValueError(f"{name} has shape {shape} of {found}, not (…, {plane_shape})")
            for z0, z1, y0, y1 in pieces_of(shape, dtype):
                piece = (z1 - z0, y1 - y0, *shape[2:])
                data = member.read(int(np.prod(piece)) * dtype.itemsize)
                yield z0, y0, np.frombuffer(data, dtype).reshape(piece)
            member.read(1)


def has_checkpoint(folder: Path) -> bool:
    """Whether an ingest can go on from what lies in this folder."""
    return (folder / JOURNAL_NAME).is_file()


def _write_array(member: IO[bytes], array: NDArray[Any] | Planes) -> None:
    if not isinstance(array, Planes):
        np.lib.format.write_array(member, array, allow_pickle=False)
        return
    header = {
        "descr": np.lib.format.dtype_to_descr(array.dtype),
        "fortran_order": False,
        "shape": array.shape,
    }
    np.lib.format.write_array_header_1_0(member, header)
    for piece in array.pieces():
        member.write(np.ascontiguousarray(piece).data.cast("B"))


def _differences(
    before: Mapping[str, Any], now: Mapping[str, Any], prefix: str = ""
) -> dict[str, tuple[Any, Any]]:
    """The fields that differ, by their path, with both values."""
    found: dict[str, tuple[Any, Any]] = {}
    for name in dict.fromkeys([*now, *before]):  # a source names its digest last
        a, b = before.get(name), now.get(name)
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            found |= _differences(a, b, f"{prefix}{name} ")
        elif a != b:
            found[prefix + name] = (a, b)
    return found
