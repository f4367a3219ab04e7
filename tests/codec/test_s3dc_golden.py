"""Codes written by version 1 decode to the same voxels for ever; and the specification is true."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc, reference

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests/golden/s3dc"
VECTORS = json.loads((GOLDEN / "vectors.json").read_text())["vectors"]

each_vector = pytest.mark.parametrize("vector", VECTORS, ids=[v["name"] for v in VECTORS])


def load(vector: dict[str, Any], suffix: str) -> NDArray[Any]:
    content = (GOLDEN / f"{vector['name']}.{suffix}").read_bytes()
    dtype = np.dtype(vector["dtype"])
    little_endian = np.frombuffer(content, dtype.newbyteorder("<"))
    return little_endian.astype(dtype).reshape(vector["shape"])


def test_the_folder_holds_every_vector_and_nothing_else() -> None:
    assert len(VECTORS) == 40
    assert {v["dtype"] for v in VECTORS} == {"uint8", "int8", "uint16", "int16", "float32"}
    assert {v["bits"] for v in VECTORS} == set(range(1, 9))
    files = {f"{v['name']}.{s}" for v in VECTORS for s in ("voxels", "code", "decoded")}
    found = {path.name for path in GOLDEN.iterdir()} - {".gitattributes"}
    assert found == files | {"vectors.json"}


@each_vector
def test_golden_code_decodes_to_its_voxels(vector: dict[str, Any]) -> None:
    code = (GOLDEN / f"{vector['name']}.code").read_bytes()
    expected = load(vector, "decoded")
    codec = S3dc(tuple(vector["block"]), vector["bits"])
    found = codec.decode(code, vector["shape"], vector["dtype"])
    assert found.tobytes() == expected.tobytes()
    again = reference.decode(code, expected.shape, expected.dtype, codec.block, codec.bits)
    assert again.tobytes() == expected.tobytes()


@each_vector
def test_golden_voxels_encode_to_their_code(vector: dict[str, Any]) -> None:
    """The end points are least and greatest, and rounding is fixed, so version 1 has one code."""
    code = (GOLDEN / f"{vector['name']}.code").read_bytes()
    assert S3dc(tuple(vector["block"]), vector["bits"]).encode(load(vector, "voxels")) == code


def test_the_script_that_made_them_makes_them_still() -> None:
    made = runpy.run_path(str(GOLDEN.parent / "make_s3dc.py"))["all_files"]()
    for name, content in made.items():
        assert (GOLDEN / name).read_bytes() == content, name


def test_the_example_of_the_specification() -> None:
    page = (ROOT / "docs/spec/s3dc.md").read_text()

    def block(kind: str) -> list[str]:
        found = re.search(rf"```{kind}\n(.*?)```", page, re.DOTALL)
        assert found, kind
        return found[1].splitlines()

    voxels = np.array([[line.split() for line in block("voxels")]]).astype(np.uint8)
    decoded = np.array([[line.split() for line in block("decoded")]]).astype(np.uint8)
    code = b"".join(bytes.fromhex(line.partition("    ")[0]) for line in block("code"))
    codec = S3dc((1, 2, 4), 4)
    assert voxels.shape == (1, 2, 5)
    assert codec.encode(voxels) == code
    np.testing.assert_array_equal(codec.decode(code, voxels.shape, np.uint8), decoded)
