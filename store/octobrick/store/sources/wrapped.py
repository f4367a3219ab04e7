"""A source on top of another: everything as there, but for what a subclass changes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from octobrick.store.sources.base import Description, Source


class WrappedSource(Source):
    """Takes its description and files from another source, and closes it with itself."""

    def __init__(self, source: Source) -> None:
        names = Description.__slots__
        super().__init__(source.path, Description(**{n: getattr(source, n) for n in names}))
        self._source = source

    @property
    def ascending(self) -> bool:
        """As the source below."""
        return self._source.ascending

    @property
    def files(self) -> tuple[Path, ...]:
        """As the source below."""
        return self._source.files

    def describe(self) -> dict[str, Any]:
        """What the source below says, with what is different here."""
        return self._source.describe() | super().describe()

    def fingerprint(self) -> dict[str, Any]:
        """That of the source below, with what is different here."""
        return self._source.fingerprint() | self.describe()

    def abandon(self) -> None:
        """As the source below."""
        self._source.abandon()

    def _close(self) -> None:
        self._source.close()
