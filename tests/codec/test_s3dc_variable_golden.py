"""Variable, predicted and scaled codes of version 1 decode to the same voxels for ever."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests/golden/s3dc_variable"
VECTORS = json.loads((GOLDEN / "vectors.json").read_text())["vectors"]

each_vector = pytest.mark.parametrize("vector", VECTORS, ids=[v["name"] for v in VECTORS])


def load(vector: dict[str, Any], suffix: str) -> NDArray[Any]:
    content = (GOLDEN / f"{vector['name']}.{suffix}").read_bytes()
    dtype = np.dtype(vector["dtype"])
    little_endian = np.frombuffer(content, dtype.newbyteorder("<"))
    return little_endian.astype(dtype).reshape(vector["shape"])


def codec_of(vector: dict[str, Any]) -> S3dc:
    return S3dc(
        tuple(vector["block"]),
        vector["bits"],
        max_error=vector["max_error"],
        scale="trained" if vector["form"] == "scaled" else "linear",
    )


def test_the_folder_holds_every_vector_and_nothing_else() -> None:
    assert len(VECTORS) == 31
    files = {f"{v['name']}.{s}" for v in VECTORS for s in ("voxels", "code", "decoded")}
    files |= {f"{v['name']}.prediction" for v in VECTORS if v["predicted"]}
    found = {path.name for path in GOLDEN.iterdir()} - {".gitattributes"}
    assert found == files | {"vectors.json"}


@each_vector
def test_golden_code_decodes_to_its_voxels(vector: dict[str, Any]) -> None:
    code = (GOLDEN / f"{vector['name']}.code").read_bytes()
    prediction = load(vector, "prediction") if vector["predicted"] else None
    found = codec_of(vector).decode(code, vector["shape"], vector["dtype"], prediction=prediction)
    assert found.tobytes() == load(vector, "decoded").tobytes()


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "float32"])
def test_the_vectors_have_every_kind_of_width(dtype: str) -> None:
    widths: set[int] = set()
    for vector in VECTORS:
        if vector["form"] == "variable" and vector["dtype"] == dtype:
            code = (GOLDEN / f"{vector['name']}.code").read_bytes()
            found = codec_of(vector).block_widths(
                code, vector["shape"], dtype, predicted=vector["predicted"]
            )
            widths |= set(found.ravel().tolist())
    sample_nbits = 8 * np.dtype(dtype).itemsize
    assert 0 in widths
    assert widths & {3, 5, 6, 7}
    assert sample_nbits == 8 or {10, 12, sample_nbits} <= widths


def test_the_script_that_made_them_makes_them_still() -> None:
    made = runpy.run_path(str(GOLDEN.parent / "make_s3dc_variable.py"))["all_files"]()
    for name, content in made.items():
        assert (GOLDEN / name).read_bytes() == content, name


def test_the_example_of_the_specification() -> None:
    page = (ROOT / "docs/spec/s3dc-variable.md").read_text()

    def block(kind: str) -> list[str]:
        found = re.search(rf"```{kind}\n(.*?)```", page, re.DOTALL)
        assert found, kind
        return found[1].splitlines()

    voxels = np.array([[line.split() for line in block("voxels")]]).astype(np.uint8)
    decoded = np.array([[line.split() for line in block("decoded")]]).astype(np.uint8)
    code = b"".join(bytes.fromhex(line.partition("    ")[0]) for line in block("code"))
    codec = S3dc((1, 2, 4), max_error=2)
    assert codec.encode(voxels) == code
    np.testing.assert_array_equal(codec.decode(code, voxels.shape, np.uint8), decoded)
