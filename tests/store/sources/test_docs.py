"""docs/formats.md names all that is read."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from octobrick.store import errors
from octobrick.store.sources.formats import FORMATS
from octobrick.store.sources.voxels import READ_DTYPES

TEXT = (Path(__file__).parents[3] / "docs" / "formats.md").read_text()


@pytest.mark.parametrize("known", FORMATS, ids=lambda known: known.name)
def test_every_format_and_suffix_is_documented(known):
    assert f"| {known.name}" in TEXT
    for suffix in known.suffixes:
        assert f"`{suffix}`" in TEXT


@pytest.mark.parametrize("dtype", READ_DTYPES)
def test_every_sample_type_is_documented(dtype):
    assert dtype in re.findall(r"\w+", TEXT.split("**Samples**")[1].split(". ")[0])


@pytest.mark.parametrize(
    "error",
    [
        errors.SourceError,
        errors.TruncatedSourceError,
        errors.SourceNotFoundError,
        errors.UnsupportedSourceError,
    ],
)
def test_every_error_and_its_kind_are_documented(error):
    assert f"`{error.__name__}` (`{error.kind}`)" in TEXT
