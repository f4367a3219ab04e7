"""What an ingest needs to go on after it was killed: one file, replaced at every checkpoint.

A checkpoint is a moment between two pieces of the source. It holds how far the source was read,
the planes that the pyramid still needs, what is known of the bricks so far, and of every shard
that is under way its length and index. Bytes written after it are cut off on resuming and written
again; as nothing depends on timing, they are the same.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.store.errors import ResumeError

JOURNAL_NAME = ".journal"
_FACTS = "facts.json"
_VERSION = 1

Arrays = dict[str, NDArray[Any]]


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

    def write(self, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace the checkpoint by this one; durable when it returns."""
        document = {"version": _VERSION, "inputs": self._inputs, "facts": facts}
        temporary = self._path.with_name(JOURNAL_NAME + ".part")
        with temporary.open("wb") as file:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
                archive.writestr(_FACTS, json.dumps(document))
                for name, array in arrays.items():
                    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                        np.lib.format.write_array(member, array, allow_pickle=False)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(self._path)

    def read(self) -> tuple[dict[str, Any], Arrays] | None:
        """The last checkpoint; None where there is none that can be read.

        Raises:
            ResumeError: it is of an ingest from another source or with other options.
        """
        try:
            with zipfile.ZipFile(self._path) as archive:
                document = json.loads(archive.read(_FACTS))
                if document["version"] != _VERSION:
                    return None
                self._require_same(document["inputs"])
                arrays = {
                    name.removesuffix(".npy"): np.lib.format.read_array(
                        io.BytesIO(archive.read(name)), allow_pickle=False
                    )
                    for name in archive.namelist()
                    if name != _FACTS
                }
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
            return None  # none yet, or damaged: the ingest starts again
        return document["facts"], arrays

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


def has_checkpoint(folder: Path) -> bool:
    """Whether an ingest can go on from what lies in this folder."""
    return (folder / JOURNAL_NAME).is_file()


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
