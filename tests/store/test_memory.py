"""Memory is bounded by the slab that is worked on, not by the volume."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

SIDE = 1024

INGEST = """
import json, sys
from octobrick.store import ingest
result = ingest(sys.argv[1], sys.argv[2], shape=(SIDE,) * 3, dtype="uint8", levels=3)
print(json.dumps(result.to_dict()))
""".replace("SIDE", str(SIDE))


def test_a_volume_of_1_gib_is_ingested_with_less_than_half_of_that_in_memory(
    tmp_path: Path,
) -> None:
    source = tmp_path / "sparse.raw"
    with source.open("wb") as file:  # mostly a hole, so that the test writes little
        file.truncate(SIDE**3)
        for z in range(0, SIDE, 100):
            file.seek(z * SIDE**2)
            file.write(bytes(range(256)) * 4096)
    command = [sys.executable, "-c", INGEST, source, tmp_path / "sparse.zarr"]
    out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    result = json.loads(out)
    assert result["levels"][0]["nbytes"] == SIDE**3
    assert 50 * 2**20 < result["peak_rss_nbytes"] < 400 * 2**20
