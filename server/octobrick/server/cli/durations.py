"""Lengths of time as people write them: ``90s``, ``15m``, ``1h``, ``30d``."""

from __future__ import annotations

import re

import click

_SECONDS = {"s": 1, "m": 60, "h": 3_600, "d": 86_400}
_LENGTH = re.compile(r"([1-9][0-9]{0,5})([smhd])")


class Duration(click.ParamType[int]):
    """A length of time; the command gets seconds."""

    name = "duration"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> int:
        """Seconds of a text such as ``1h``."""
        if isinstance(value, int):
            return value
        match = _LENGTH.fullmatch(str(value))
        if match is None:
            self.fail(f"{value!r} is no length of time such as 90s, 15m, 1h or 30d", param, ctx)
        return int(match[1]) * _SECONDS[match[2]]
