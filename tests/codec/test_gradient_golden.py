"""Codes written by version 1 decode to the same directions for ever; the specification is true."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octobrick.codec import gradients
from octobrick.codec import reference_gradients as reference

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests/golden/gradients"
VECTORS = json.loads((GOLDEN / "vectors.json").read_text())["vectors"]

each_case = pytest.mark.parametrize("case", VECTORS, ids=[v["name"] for v in VECTORS])


def load(case: dict[str, Any], suffix: str, dtype: str) -> Any:
    content = (GOLDEN / f"{case['name']}.{suffix}").read_bytes()
    return np.frombuffer(content, dtype).reshape(case["count"], 3)


def test_the_folder_holds_every_vector_and_nothing_else() -> None:
    names = {v["name"] for v in VECTORS}
    assert names == {"all_over", "borders", "holes", "lengths", "zeros", "any_bytes"}
    files = {f"{n}.{s}" for n in names for s in ("vectors", "code", "decoded")}
    found = {path.name for path in GOLDEN.iterdir()} - {".gitattributes", "vectors.json"}
    assert found == files - {"any_bytes.vectors"}


@each_case
def test_golden_code_decodes_to_its_bits(case: dict[str, Any]) -> None:
    code, expected = load(case, "code", "u1"), load(case, "decoded", "<f4")
    assert gradients.decode_directions(code).astype("<f4").tobytes() == expected.tobytes()
    assert reference.decode_directions(code).astype("<f4").tobytes() == expected.tobytes()


@pytest.mark.parametrize("case", VECTORS[:-1], ids=[v["name"] for v in VECTORS[:-1]])
def test_golden_vectors_encode_to_their_code(case: dict[str, Any]) -> None:
    """More than the format asks of an encoder; this one's choices are pinned all the same."""
    code = gradients.encode_directions(load(case, "vectors", "<f8"))
    np.testing.assert_array_equal(code, load(case, "code", "u1"))


def test_the_script_that_made_them_makes_them_still() -> None:
    made = runpy.run_path(str(GOLDEN.parent / "make_gradients.py"))["all_files"]()
    for name, content in made.items():
        assert (GOLDEN / name).read_bytes() == content, name


def test_the_example_of_the_specification() -> None:
    page = (ROOT / "docs/spec/gradient-code.md").read_text()
    found = re.search(r"```directions\n(.*?)```", page, re.DOTALL)
    assert found
    for line in found[1].splitlines():
        words = line.split()
        vector, decoded = np.array([words[:3]], np.float32), np.array([words[6:]], np.float32)
        code = np.array([[int(word, 16) for word in words[3:6]]], np.uint8)
        np.testing.assert_array_equal(gradients.encode_directions(vector), code)
        found_vector = gradients.decode_directions(code)
        np.testing.assert_allclose(found_vector, decoded, atol=8e-8, rtol=0)
