"""What a render worker is asked and what it answers: values that travel as JSON and bytes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from octobrick.codec.errors import OctobrickError

if TYPE_CHECKING:
    from octobrick.server.catalog import Stamp

Format = Literal["png", "webp", "jpeg"]

CONTENT_TYPES: dict[Format, str] = {
    "png": "image/png",
    "webp": "image/webp",
    "jpeg": "image/jpeg",
}

Json = dict[str, Any]

_TOKEN = re.compile(r"[a-z-]{1,40}")  # it becomes part of a header


@dataclass(frozen=True, slots=True)
class RenderTask:
    """One picture of a volume as it was when somebody looked.

    Attributes:
        path: of the volume's folder.
        stamp: tells whether that is still the same volume; None if it was gone already.
        revision: that it must have.
        picture: the fields of a `PictureBody`.
    """

    path: str
    stamp: Stamp | None
    revision: str
    picture: Json

    def to_json(self) -> Json:
        """JSON-ready fields."""
        return asdict(self)

    @classmethod
    def from_json(cls, given: Json) -> RenderTask:
        """The task that `to_json` wrote."""
        stamp = given["stamp"]
        a_stamp = None if stamp is None else (stamp[0], stamp[1], stamp[2], stamp[3])
        return cls(given["path"], a_stamp, given["revision"], given["picture"])


@dataclass(frozen=True, slots=True)
class PicturePart:
    """A picture, or the first, coarse one of a progressive answer.

    Attributes:
        body: the file's bytes.
        content_type: of these.
        final: no better one follows.
        level: that was shown.
        max_error: largest error of the codec in what was sampled.
        converged: neither time nor memory would change the picture.
        seconds: that it took, by what.
        memory: bytes that the renderer holds, by what.
    """

    body: bytes
    content_type: str
    final: bool
    level: int
    max_error: float
    converged: bool
    seconds: dict[str, float]
    memory: dict[str, int]

    def to_json(self) -> Json:
        """JSON-ready fields, without the bytes."""
        return {name: getattr(self, name) for name in self.__slots__ if name != "body"}

    @classmethod
    def from_json(cls, given: Json, body: bytes) -> PicturePart:
        """The part that `to_json` wrote.

        Raises:
            TypeError, ValueError, KeyError: it did not: a worker may be broken.
        """
        if given["content_type"] not in CONTENT_TYPES.values():
            raise ValueError(f"no picture is {given['content_type']!r}")
        return cls(
            body,
            given["content_type"],
            bool(given["final"]),
            int(given["level"]),
            float(given["max_error"]),
            bool(given["converged"]),
            {name: float(s) for name, s in given["seconds"].items() if _TOKEN.fullmatch(name)},
            {str(name): int(nbytes) for name, nbytes in given["memory"].items()},
        )


def error_to_json(error: OctobrickError) -> Json:
    """An error of any class, with the kinds of its bases for who does not know it."""
    mro = type(error).__mro__
    kinds = [cls.kind for cls in mro if issubclass(cls, OctobrickError)]
    return {"kinds": kinds, "message": error.message, "facts": error.facts}


def error_from_json(given: Json) -> OctobrickError:
    """The error that `error_to_json` wrote, or its nearest base that is known here."""
    # Where two classes have one kind, the one nearest to the root counts.
    classes = {cls.kind: cls for cls in reversed(list(_all_classes(OctobrickError)))}
    known = (classes[kind] for kind in given["kinds"] if kind in classes)
    cls: type[OctobrickError] = next(known, OctobrickError)
    error = cls.__new__(cls)  # whatever arguments its own class may want
    OctobrickError.__init__(error, str(given["message"]), **given["facts"])
    return error


def _all_classes(cls: type[OctobrickError]) -> Iterator[type[OctobrickError]]:
    yield cls
    for sub in cls.__subclasses__():
        yield from _all_classes(sub)
