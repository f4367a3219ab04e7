"""Bricks over HTTP, beside nginx that serves the same bytes as files; and many slow readers.

    script/bench service_bricks [--quick] [--json FILE]

`wrk` on loopback, 8 connections, all from the page cache; rounds in which all take turns, medians.
Bricks of about 100 kB: 64³ voxels of noise, S3Dc with 3 bits. With one worker and with two:

    nginx      the same bytes as static files (sendfile, no log), as many workers
    direct     `octobrick serve`: uvicorn, bricks answered where the request was parsed
    uvicorn    the application alone, under uvicorn (uvloop, httptools)
    granian    the application alone, under granian (uvloop)
    304        `serve`, asked with If-None-Match

Then 1,000 clients that read 4 kB a second each, and what the server's memory does meanwhile.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import resource
import statistics
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import _measure
import _service
import numpy as np

CONNECTIONS = 8
READERS = 1_000
READ_NBYTES = 4_096  # a second, each
_ADDRESSES = """
local paths = {%s}
local requests, n = {}, 0
wrk.headers["Accept-Encoding"] = "zstd"
init = function(args)
  for i, path in ipairs(paths) do
    if args[1] == "304" then
      local revision, brick = path:match("/(%%x+)/bricks/(.+)$")
      wrk.headers["If-None-Match"] = '"' .. revision .. "-" .. brick:gsub("/", ".") .. '-zstd"'
    end
    requests[i] = wrk.format("GET", path)
  end
end
request = function() n = n %% #requests + 1; return requests[n] end
done = function(summary, latency)
  local e = summary.errors
  print(string.format(
    'RESULT {"requests": %%d, "microseconds": %%d, "nbytes": %%d, "p50": %%d, "p99": %%d, ' ..
    '"errors": %%d}',
    summary.requests, summary.duration, summary.bytes, latency:percentile(50),
    latency:percentile(99), e.connect + e.read + e.write + e.status + e.timeout))
end
"""


def make_bricks(folder: Path) -> list[str]:
    """A volume in `volumes`, its bricks as files in `files`; the addresses of both."""
    from octobrick.codec import S3dc
    from octobrick.store import ingest, open_volume

    voxels = np.random.default_rng(1).integers(0, 2**16, (256, 256, 256), np.uint16)
    np.save(folder / "noise.npy", voxels)
    (folder / "volumes").mkdir()
    ingest(folder / "noise.npy", folder / "volumes/noise.zarr", codec=S3dc(bits=3), brick=64)
    paths = []
    with open_volume(folder / "volumes/noise.zarr") as volume:
        for zyx in np.ndindex(*volume.levels[0].grid_zyx):
            z, y, x = (int(i) for i in zyx)
            path = f"/v1/volumes/noise/{volume.revision}/bricks/0/0/0/{z}/{y}/{x}"
            stored = volume.stored_brick(0, (z, y, x))
            assert stored is not None
            (folder / f"files{path}").parent.mkdir(parents=True, exist_ok=True)
            (folder / f"files{path}").write_bytes(stored)
            paths.append(path)
    (folder / "walk.lua").write_text(_ADDRESSES % ", ".join(f'"{path}"' for path in paths))
    return paths


def wrk(script: Path, port: int, seconds: int, *arguments: str) -> dict[str, float]:
    """One run: requests a second, milliseconds of latency."""
    # fmt: off
    command = [
        _service.require("wrk", "wrk"), "-t1", f"-c{CONNECTIONS}", f"-d{seconds}s",
        "-s", str(script), f"http://127.0.0.1:{port}", "--", *arguments,
    ]
    # fmt: on
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    line = next(line for line in text.splitlines() if line.startswith("RESULT "))
    result = json.loads(line.removeprefix("RESULT "))
    if result["errors"]:
        raise RuntimeError(f"wrk met {result['errors']} errors at port {port}:\n{text}")
    return {
        "per_second": result["requests"] / result["microseconds"] * 1e6,
        "p50_ms": result["p50"] / 1e3,
        "p99_ms": result["p99"] / 1e3,
        "nbytes_each": result["nbytes"] / max(result["requests"], 1),
    }


def throughput(folder: Path, workers: int, rounds: int, seconds: int) -> dict[str, Any]:
    """Medians of all servers with so many workers, which take turns; and ratios to nginx."""
    with contextlib.ExitStack() as stack:
        ports = {
            "nginx": stack.enter_context(
                _service.nginx(folder / "files", workers, folder / f"nginx{workers}")
            )[0]
        }
        for server in _service.SERVERS:
            ports[server] = stack.enter_context(
                _service.octobrick(folder / "volumes", workers, server)
            )[0]
        ports["304"] = ports["serve"]
        script = folder / "walk.lua"
        runs: dict[str, list[dict[str, float]]] = {name: [] for name in ports}
        for port in ports.values():
            wrk(script, port, 1)  # warms each worker's tables
        for _ in range(rounds):
            for name, port in ports.items():
                runs[name].append(wrk(script, port, seconds, name))
    found: dict[str, Any] = {
        name: {key: statistics.median(run[key] for run in of) for key in of[0]}
        for name, of in runs.items()
    }
    for name in _service.SERVERS:
        ratios = [
            ours["per_second"] / theirs["per_second"]
            for ours, theirs in zip(runs[name], runs["nginx"], strict=True)
        ]
        found[name]["of_nginx"] = found[name]["per_second"] / found["nginx"]["per_second"]
        found[name]["of_nginx_each_round"] = ratios
    return found


async def read_slowly(port: int, path: str, until: asyncio.Event) -> int:
    """Ask for a brick again and again, and take a few kB of it each second; bytes taken."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=READ_NBYTES)
    taken = 0
    try:
        while not until.is_set():
            writer.write(
                f"GET {path} HTTP/1.1\r\nHost: x\r\nAccept-Encoding: zstd\r\n\r\n".encode()
            )
            head = await reader.readuntil(b"\r\n\r\n")
            assert head.startswith(b"HTTP/1.1 200"), head
            left = int(head.lower().split(b"content-length: ")[1].split(b"\r\n")[0])
            while left and not until.is_set():
                piece = await reader.read(min(READ_NBYTES, left))
                if not piece:
                    raise ConnectionError("the server cut a slow reader off")
                left -= len(piece)
                taken += len(piece)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(until.wait(), 1)
    finally:
        writer.close()
    return taken


async def sample(port: int, pid: int, paths: list[str], seconds: int) -> dict[str, Any]:
    """The server's memory each second, while all read."""
    until = asyncio.Event()
    before = rss_nbytes(pid)
    readers = [
        asyncio.create_task(read_slowly(port, paths[i % len(paths)], until)) for i in range(READERS)
    ]
    rss = []
    for _ in range(seconds):
        await asyncio.sleep(1)
        rss.append(rss_nbytes(pid))
    until.set()
    done = await asyncio.gather(*readers, return_exceptions=True)
    failed = [error for error in done if isinstance(error, BaseException)]
    return {
        "readers": READERS,
        "failed": len(failed),
        "first_failure": repr(failed[0]) if failed else None,
        "kb_per_second_each": sum(n for n in done if isinstance(n, int)) / READERS / seconds / 1e3,
        "rss_before_mib": before / 2**20,
        "rss_after_connect_mib": max(rss[: seconds // 4]) / 2**20,
        "rss_end_mib": rss[-1] / 2**20,
        "rss_max_mib": max(rss) / 2**20,
        "rss_each_second_mib": [round(n / 2**20, 1) for n in rss],
    }


def rss_nbytes(pid: int) -> int:
    """Resident memory of a process."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024
    raise RuntimeError(f"process {pid} has no memory")


def slow_readers(folder: Path, paths: list[str], seconds: int) -> dict[str, Any]:
    """Many clients that take their time."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # the server's too: it is our child
    with _service.octobrick(folder / "volumes", 1, "serve") as (port, pid):
        wrk(folder / "walk.lua", port, 2)
        return asyncio.run(sample(port, pid, paths, seconds))


def run(_data: Path, quick: bool) -> dict[str, Any]:
    """All of it; no shared volume is read."""
    _service.require("wrk", "wrk")
    _service.require("nginx", "nginx-light")
    rounds, seconds = (2, 1) if quick else (5, 5)
    with TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)  # nginx's workers may be another user
        paths = make_bricks(folder)
        return {
            "rounds": rounds,
            "seconds": seconds,
            "workers": {str(n): throughput(folder, n, rounds, seconds) for n in (1, 2)},
            "slow_readers": slow_readers(folder, paths, 8 if quick else 30),
        }


def table(result: dict[str, Any]) -> str:
    """Servers by workers; then the slow readers."""
    rows = []
    for workers, found in result["workers"].items():
        for name, row in found.items():
            each = row.get("of_nginx_each_round")
            rows.append(
                [
                    f"{name}, {workers} worker{'s' if workers != '1' else ''}",
                    f"{row['per_second']:,.0f}",
                    f"{row['of_nginx']:.2f}" if each else "",
                    f"{min(each):.2f} – {max(each):.2f}" if each else "",
                    f"{row['p50_ms']:.2f}",
                    f"{row['p99_ms']:.2f}",
                    f"{row['nbytes_each'] / 1e3:.1f}",
                ]
            )
    slow = result["slow_readers"]
    return "\n\n".join(
        [
            _measure.layout(
                ["", "requests/s", "of nginx", "each round", "p50 ms", "p99 ms", "kB"], rows
            ),
            f"{slow['readers']:,} readers of {slow['kb_per_second_each']:.1f} kB/s each, "
            f"{slow['failed']} failed; server's memory {slow['rss_before_mib']:.0f} MiB before, "
            f"{slow['rss_after_connect_mib']:.0f} when all had asked, {slow['rss_max_mib']:.0f} at "
            f"most, {slow['rss_end_mib']:.0f} at the end",
        ]
    )


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
