"""A small ``.json`` beside a raw file that says what its bytes are.

    {"shape": [128, 128, 128], "dtype": "uint16", "spacing": [1.5, 0.4, 0.4]}

``shape`` and ``spacing`` are in the order z, y, x; ``shape_zyx``, ``spacing_zyx`` and
``spacing_xyz`` say their order themselves. Also read: ``endian`` (``"little"`` or ``"big"``) and
``offset_nbytes``. Other keys are left alone.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

from octobrick.store.sources.head import HEADER_LIMIT_NBYTES, parsing, read_head


class Sidecar(NamedTuple):
    """What a sidecar file says; None or a default for what it does not."""

    path: Path
    shape_zyx: tuple[int, ...] | None
    dtype: str | None
    spacing_zyx: tuple[float, ...] | None
    offset_nbytes: int
    big_endian: bool


def find_sidecar(raw: Path) -> Sidecar | None:
    """The description beside a raw file: of ``a.raw.gz`` that is a.raw.gz.json, a.raw.json, a.json.

    Raises:
        SourceError: there is one, but it cannot be understood.
    """
    stem = raw.with_suffix("") if raw.suffix.lower() == ".gz" else raw
    names = dict.fromkeys([f"{raw.name}.json", f"{stem.name}.json", f"{stem.stem}.json"])
    for path in (raw.with_name(name) for name in names):
        if path.is_file() and path != raw:
            return _read(path)
    return None


def _read(path: Path) -> Sidecar:
    text = read_head(path, HEADER_LIMIT_NBYTES)
    with parsing(path, "JSON"):
        content = json.loads(text)
        if not isinstance(content, dict):
            raise TypeError("an object with shape and dtype is expected")
        spacing = _numbers(content, float, "spacing_zyx", "spacing")
        if spacing is None and (xyz := _numbers(content, float, "spacing_xyz")):
            spacing = xyz[::-1]
        return Sidecar(
            path=path,
            shape_zyx=_numbers(content, int, "shape_zyx", "shape"),
            dtype=_text(content, "dtype"),
            spacing_zyx=spacing,
            offset_nbytes=int(content.get("offset_nbytes", 0)),
            big_endian=_is_big(content),
        )


def _numbers(content: dict[str, Any], kind: type[Any], *keys: str) -> tuple[Any, ...] | None:
    for key in keys:
        if key in content:
            values = content[key]
            allowed = (int,) if kind is int else (int, float)
            if not isinstance(values, list) or not all(type(v) in allowed for v in values):
                raise TypeError(f"{key} is {values!r}, a list of numbers is expected")
            return tuple(kind(value) for value in values)
    return None


def _text(content: dict[str, Any], key: str) -> str | None:
    value = content.get(key)
    if value is not None and not isinstance(value, str):
        raise TypeError(f"{key} is {value!r}, text is expected")
    return value


def _is_big(content: dict[str, Any]) -> bool:
    endian = content.get("endian", "little")
    if endian not in ("little", "big"):
        raise ValueError(f"endian is {endian!r}, 'little' or 'big' is expected")
    return bool(endian == "big")
