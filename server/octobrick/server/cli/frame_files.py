"""The frames of a movie as files of their own, numbered from 1, and what was made of them so far.

Beside them lies a note of what they show, so that a stopped movie only goes on as it began.
"""

from __future__ import annotations

import contextlib
import json
import re
from pathlib import Path
from typing import Any

from octobrick.codec.errors import InvalidInputError

_NUMBER = re.compile(r"%0?(\d*)d")
_IN_FOLDER = "frame_%04d.png"


class FrameFiles:
    """Numbered picture files in one folder.

    Args:
        out: a folder, for ``frame_0001.png`` and so on; or a pattern with one ``%04d`` in its name.

    Raises:
        InvalidInputError: another pattern.
    """

    def __init__(self, out: Path) -> None:
        self._pattern = out if "%" in out.name else out / _IN_FOLDER
        name = self._pattern.name
        found = _NUMBER.findall(name)
        if len(found) != 1 or "%" in _NUMBER.sub("", name) or "%" in str(self._pattern.parent):
            raise InvalidInputError(
                f"{out}: a pattern of frames has one number, in its last part, such as "
                "out/frame_%04d.png"
            )
        self._digits = int(found[0] or 0)
        stem = _NUMBER.sub("", self._pattern.stem).rstrip("_-. ")
        self._note = self._pattern.with_name(f"{stem}_movie.json" if stem else "movie.json")

    @property
    def pattern(self) -> Path:
        """The names of all frames, with the number as ``%04d``."""
        return self._pattern

    def path(self, index: int) -> Path:
        """The file of a frame, counted from 0; files are counted from 1."""
        number = f"{index + 1:0{self._digits}d}" if self._digits else str(index + 1)
        return self._pattern.with_name(_NUMBER.sub(number, self._pattern.name))

    def begin(self, shown: dict[str, Any], *, resume: bool, overwrite: bool) -> None:
        """Make the folder ready for frames that show what is described.

        Args:
            shown: all that decides what frames look like, JSON-ready.
            resume: keep the frames that are there, if they show the same.
            overwrite: remove them, and begin anew.

        Raises:
            DestinationExistsError: there are frames, and neither was asked for.
            InvalidInputError: the frames to go on with show something else.
        """
        from octobrick.store.errors import DestinationExistsError

        self._pattern.parent.mkdir(exist_ok=True)
        old = self._existing()
        if old and overwrite:
            self._note.unlink(missing_ok=True)
            for file in old:
                file.unlink()
        elif old and not resume:
            raise DestinationExistsError(
                f"{old[0]}: already exists; go on with its movie (--resume), begin anew "
                "(--overwrite), or choose another name",
                path=str(old[0]),
            )
        elif old:
            self._require_same(shown)
        self._note.write_text(json.dumps(shown, indent=1) + "\n", encoding="utf-8")

    def _existing(self) -> list[Path]:
        prefix, suffix = (re.escape(part) for part in re.split(r"%0?\d*d", self._pattern.name))
        wanted = re.compile(rf"{prefix}\d+{suffix}")
        return sorted(p for p in self._pattern.parent.iterdir() if wanted.fullmatch(p.name))

    def _require_same(self, shown: dict[str, Any]) -> None:
        noted: Any = None
        with contextlib.suppress(OSError, ValueError):
            noted = json.loads(self._note.read_text(encoding="utf-8"))
        if not isinstance(noted, dict):
            raise InvalidInputError(
                f"{self._note}: does not say what the frames beside it show; begin anew "
                "(--overwrite), or choose another name"
            )
        ours = json.loads(json.dumps(shown))
        for name in sorted(noted.keys() | ours.keys()):
            if noted.get(name) != ours.get(name):
                raise InvalidInputError(
                    f"{self._pattern.parent}: frames there were made with {name} "
                    f"{_short(noted.get(name))}, now it is {_short(ours.get(name))}; call it as "
                    "before, begin anew (--overwrite), or choose another name",
                    field=name,
                )


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}…"
