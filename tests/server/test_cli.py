"""The command line: what it prints, where, and with which exit code."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from octobrick.codec import S3dc, Zerobit
from octobrick.server.cli import main
from octobrick.server.cli.progress import ProgressReport
from octobrick.server.cli.text import format_nbytes, format_psnr, format_ratio, format_seconds
from octobrick.store import Progress, open_volume


@pytest.fixture
def run() -> Callable[..., Result]:
    """Run the command line in this process."""

    def invoke(*arguments: object) -> Result:
        return CliRunner().invoke(main, [str(argument) for argument in arguments])

    return invoke


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "ramp.npy"
    np.save(path, np.arange(20 * 24 * 28, dtype=np.uint16).reshape(20, 24, 28))
    return path


def test_help_lists_the_commands(run: Callable[..., Result]) -> None:
    for option in ("--help", "-h"):
        result = run(option)
        assert result.exit_code == 0
        for command in ("ingest", "info", "render", "serve"):
            assert command in result.stdout


def test_no_command_is_help_and_a_wrong_call(run: Callable[..., Result]) -> None:
    result = run()
    assert result.exit_code == 2
    assert "ingest" in result.stderr


def test_ingest_ends_with_a_table_and_totals(
    run: Callable[..., Result], source: Path, tmp_path: Path
) -> None:
    result = run("ingest", source, tmp_path / "ramp.zarr", "--brick", 16)
    assert result.exit_code == 0, result.stderr
    assert "ramp.npy: npy, uint16, 20×24×28 voxels" in result.stdout
    assert "PSNR" in result.stdout
    assert "20×24×28" in result.stdout
    assert "10×12×14" in result.stdout
    assert "MB/s, peak memory" in result.stdout
    assert open_volume(tmp_path / "ramp.zarr").revision in result.stdout


def test_ingest_json_is_all_there_is_on_stdout(
    run: Callable[..., Result], source: Path, tmp_path: Path
) -> None:
    result = run("ingest", source, tmp_path / "ramp.zarr", "--brick", 16, "--json")
    outcome = json.loads(result.stdout)
    assert outcome["shape_zyx"] == [20, 24, 28]
    assert [level["index"] for level in outcome["levels"]] == [0, 1]
    assert outcome["peak_rss_nbytes"] > 0


def test_quiet_ingest_prints_nothing(
    run: Callable[..., Result], source: Path, tmp_path: Path
) -> None:
    result = run("ingest", source, tmp_path / "ramp.zarr", "--quiet")
    assert (result.exit_code, result.output) == (0, "")


def test_ingest_options_reach_the_volume(run: Callable[..., Result], tmp_path: Path) -> None:
    raw = tmp_path / "voxels.raw"
    voxels = np.arange(20 * 24 * 28, dtype=">u2").reshape(20, 24, 28)
    raw.write_bytes(b"header" + voxels.tobytes())
    dest = tmp_path / "v.zarr"
    result = run(
        *("ingest", raw, dest, "--shape", "20,24,28", "--dtype", "uint16", "--offset", 6),
        *("--big-endian", "--spacing", "3,2,0.5", "--codec", "lossless", "--brick", 32),
        *("--levels", 1, "--workers", 1),
    )
    assert result.exit_code == 0, result.stderr
    with open_volume(dest) as volume:
        assert volume.codec is None
        assert len(volume.levels) == 1
        assert volume.levels[0].spacing_xyz == (0.5, 2.0, 3.0)
        assert volume.brick_shape_zyx == (32, 32, 32)
        np.testing.assert_array_equal(volume.read(0), voxels)


def test_codec_options_reach_the_volume(
    run: Callable[..., Result], source: Path, tmp_path: Path
) -> None:
    assert run("ingest", source, tmp_path / "v.zarr", "--bits", 2, "--block", 4).exit_code == 0
    codec = open_volume(tmp_path / "v.zarr").codec
    assert codec == S3dc((4, 4, 4), bits=2)


def test_zerobit_options_reach_the_volume(
    run: Callable[..., Result], source: Path, tmp_path: Path
) -> None:
    arguments = ("--codec", "zerobit", "--details", 0.2, "--background", 5)
    result = run("ingest", source, tmp_path / "v.zarr", *arguments)
    assert result.exit_code == 0, result.stderr
    assert open_volume(tmp_path / "v.zarr").codec == Zerobit(0.2, background=5)
    assert "zerobit; details=0.2" in run("info", tmp_path / "v.zarr").stdout


def test_gradients_and_memory_reach_the_ingest(
    run: Callable[..., Result], source: Path, tmp_path: Path
) -> None:
    options = ("--brick", 16, "--gradients", "--memory", "1.5GiB")
    result = run("ingest", source, tmp_path / "v.zarr", *options)
    assert result.exit_code == 0, result.stderr
    assert "gradients" in result.stdout
    stored = open_volume(tmp_path / "v.zarr").gradients
    assert stored is not None
    assert stored.levels == (1,)
    assert "of levels 1 to 1" in run("info", tmp_path / "v.zarr").stdout
    short = run("ingest", source, tmp_path / "w.zarr", "--memory", "1MB")
    assert (short.exit_code, "takes at least" in short.stderr) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "exit_code", "kind"),
    [
        (["{source}", "v.zarr", "--memory", "much"], 2, "invalid-input"),
        (["nothing.npy", "v.zarr"], 1, "source-not-found"),
        (["{source}", "there.zarr"], 1, "destination-exists"),
        (["{source}", "v.zarr", "--bits", "9"], 2, "invalid-input"),
        (["{source}", "v.zarr", "--brick", "7"], 2, "invalid-input"),
        (["{source}", "v.zarr", "--codec", "lossless", "--bits", "4"], 2, "invalid-input"),
        (["{source}", "v.zarr", "--codec", "zerobit", "--bits", "4"], 2, "invalid-input"),
        (["{source}", "v.zarr", "--codec", "zerobit", "--details", "2"], 2, "invalid-input"),
        (["{source}", "v.zarr", "--codec", "zerobit", "--background", "-5"], 2, "invalid-input"),
        (["{source}", "v.zarr", "--codec", "s3dc", "--details", "0.1"], 2, "invalid-input"),
        (["{source}", "v.zarr", "--codec", "jpeg"], 2, "invalid-input"),
        (["{source}", "v.zarr", "--spacing", "1,2"], 2, "invalid-input"),
        (["{source}"], 2, "invalid-input"),
        (["{source}", "v.zarr", "--no-such-option"], 2, "invalid-input"),
        (["{nan}", "v.zarr"], 2, "not-finite"),
    ],
)
def test_bad_ingest_is_one_line_with_kind_and_exit_code_and_leaves_no_volume(
    run: Callable[..., Result],
    source: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    exit_code: int,
    kind: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.zarr").mkdir()
    np.save(tmp_path / "nan.npy", np.full((4, 4, 4), np.nan, np.float32))
    result = run("ingest", *(a.format(source=source, nan="nan.npy") for a in arguments))
    assert result.exit_code == exit_code
    assert result.stderr.startswith(f"octobrick: error [{kind}]: ")
    assert result.stderr.count("\n") == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["nan.npy", "ramp.npy", "there.zarr"]


def moment(elapsed_seconds: float) -> Progress:
    return Progress("encode", 250_000_000, 10**9, elapsed_seconds, 5e7, 15.0, 212_000_000)


def test_progress_elsewhere_than_on_a_terminal_is_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with ProgressReport(itemsize=2, quiet=False) as report:
        for elapsed_seconds in (1, 9, 10.5, 12, 20, 21):
            report(moment(elapsed_seconds))
    line = "encode 25 %, 100 MB/s, 50 Mvoxel/s, 15.0 s left, 212.0 MB in memory\n"
    assert capsys.readouterr() == ("", 2 * line)


def test_progress_on_a_terminal_is_a_bar(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # to rich this means a terminal
    monkeypatch.setenv("COLUMNS", "160")
    with ProgressReport(itemsize=2, quiet=False) as report:
        report(moment(1))
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().err)
    assert "━" in shown
    assert "25%" in shown
    assert "100 MB/s, 50 Mvoxel/s, 15.0 s left" in shown


def test_quiet_progress_is_silent(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with ProgressReport(itemsize=2, quiet=True) as report:
        report(moment(11))
    assert capsys.readouterr() == ("", "")


def test_interrupted_ingest_leaves_nothing_and_says_so(
    run: Callable[..., Result], source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("octobrick.server.cli.progress.ProgressReport.__call__", interrupt)
    result = run("ingest", source, tmp_path / "v.zarr")
    assert result.exit_code == 130
    assert "interrupted; nothing was left behind" in result.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["ramp.npy"]


def test_info_of_a_volume(run: Callable[..., Result], volumes_template: Path) -> None:
    result = run("info", volumes_template / "head.zarr")
    assert result.exit_code == 0, result.stderr
    assert "uint16" in result.stdout
    assert "20×18×25" in result.stdout
    metadata = json.loads(run("info", volumes_template / "head.zarr", "--json").stdout)
    assert metadata["name"] == "head"
    assert len(metadata["levels"]) == 3


def test_info_of_a_source(run: Callable[..., Result], source: Path) -> None:
    assert "uint16" in run("info", source).stdout
    assert json.loads(run("info", source, "--json").stdout)["shape_zyx"] == [20, 24, 28]


def test_info_of_what_is_not_there(run: Callable[..., Result], tmp_path: Path) -> None:
    for name, kind in (("gone.zarr", "volume-not-found"), ("gone.npy", "source-not-found")):
        result = run("info", tmp_path / name)
        assert result.exit_code == 1
        assert f"[{kind}]" in result.stderr
        assert name in result.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "no such folder"),
        ([".", "--port", "70000"], "setting port"),
        ([".", "--log-level", "loud"], "--log-level"),
    ],
)
def test_bad_serve_is_refused_before_it_starts(
    run: Callable[..., Result],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("serve", *arguments)
    assert result.exit_code == 2
    assert result.stderr.startswith("octobrick: error [invalid-input]: ")
    assert message in result.stderr


def test_unexpected_error_shows_its_traceback_only_on_demand(
    run: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("what now")

    monkeypatch.setattr("octobrick.store.sources.open_source", fail)
    plain, debug = run("info", "x.npy"), run("--debug", "info", "x.npy")
    assert plain.exit_code == debug.exit_code == 1
    assert plain.stderr.count("\n") == 1
    assert "[internal]: ZeroDivisionError: what now" in plain.stderr
    assert "Traceback" in debug.stderr


def test_numbers_with_commas(run: Callable[..., Result]) -> None:
    for text, ok in (("1,2,3", True), ("1,2", False), ("1,b,3", False), ("", False)):
        result = run("ingest", "nothing.raw", "v.zarr", "--shape", text, "--dtype", "uint8")
        assert ("is not 3 whole numbers like 64,512,512" in result.stderr) is not ok


@pytest.mark.parametrize("text", ["768", "0x5", "axb", "-1x5", "5x", "1.5x2"])
def test_senseless_size_is_refused(run: Callable[..., Result], text: str) -> None:
    result = run("render", "v.zarr", "-o", "v.png", "--size", text)
    assert result.exit_code == 2
    assert "is not a size like 768x768" in result.stderr


def test_numbers_as_text() -> None:
    assert [format_nbytes(n) for n in (0, 999, 1000, 14_155_776, 999_960_000, 2e15)] == [
        *("0 B", "999 B", "1.0 kB", "14.2 MB", "1.0 GB", "2000.0 TB")
    ]
    assert [format_seconds(s) for s in (0.04, 59.9, 61, 3661)] == [
        *("0.0 s", "59.9 s", "1:01", "1:01:01")
    ]
    assert (format_psnr(None), format_psnr(47.25)) == ("exact", "47.2 dB")
    assert (format_ratio(10, 4), format_ratio(10, 0)) == ("2.5", "–")


def test_help_imports_nothing_heavy() -> None:
    """A second of imports before --help answers is a second too many."""
    import subprocess
    import sys

    program = (
        "import sys; from octobrick.server.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'zarr', 'fastapi', 'pydantic', 'moderngl', 'rich.progress'}\n"
        "sys.exit(', '.join(heavy & sys.modules.keys()) or None)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
