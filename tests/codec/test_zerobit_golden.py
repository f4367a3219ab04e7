"""Codes written by version 1 decode to the same voxels for ever."""

from __future__ import annotations

import json
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octobrick.codec import Codebook, Zerobit
from octobrick.codec import reference_zerobit as reference

GOLDEN = Path(__file__).parents[1] / "golden/zerobit"
VECTORS = json.loads((GOLDEN / "vectors.json").read_text())["vectors"]

each_vector = pytest.mark.parametrize("vector", VECTORS, ids=[v["name"] for v in VECTORS])


def files(vector: dict[str, Any]) -> dict[str, bytes]:
    paths = GOLDEN.glob(f"{vector['name']}.*")
    return {path.suffix[1:]: path.read_bytes() for path in paths}


def test_the_folder_holds_every_vector_and_nothing_else() -> None:
    assert len(VECTORS) == 19
    assert {v["dtype"] for v in VECTORS} == {"uint8", "int8", "uint16", "int16", "float32"}
    names = {f"{v['name']}.{s}" for v in VECTORS for s in ("voxels", "code", "decoded")}
    names |= {f"{v['name']}.codebook" for v in VECTORS if v["shared"]}
    found = {path.name for path in GOLDEN.iterdir()} - {".gitattributes"}
    assert found == names | {"vectors.json"}


@each_vector
def test_golden_code_decodes_to_its_voxels(vector: dict[str, Any]) -> None:
    content = files(vector)
    codebook = content.get("codebook")
    codec = Zerobit(codebook=None if codebook is None else Codebook(codebook))
    decoded = codec.decode(content["code"], vector["shape"], vector["dtype"])
    little_endian = decoded.dtype.newbyteorder("<")
    assert decoded.astype(little_endian).tobytes() == content["decoded"]
    again = reference.decode(content["code"], codebook=codebook or b"")
    assert again.astype(little_endian).tobytes() == content["decoded"]


@each_vector
def test_a_golden_code_is_near_its_voxels(vector: dict[str, Any]) -> None:
    """Of the noise without details, only averages are kept; of all else, more than half."""
    content = files(vector)
    little_endian = np.dtype(vector["dtype"]).newbyteorder("<")
    voxels, decoded = (
        np.frombuffer(content[name], little_endian).astype(np.float64)
        for name in ("voxels", "decoded")
    )
    spread = voxels.std()
    if vector["ratio"] > 0:
        assert np.sqrt(((voxels - decoded) ** 2).mean()) <= spread / 2
    else:
        assert decoded.std() < spread


def test_the_script_that_made_them_makes_them_still() -> None:
    made = runpy.run_path(str(GOLDEN.parent / "make_zerobit.py"))["all_files"]()
    for name, content in made.items():
        assert (GOLDEN / name).read_bytes() == content, name
