"""What script/lib/system.sh does on machines that this one is not: no compiler, no root, no apt.

The machine is played by a PATH with stand-ins, so that nothing is installed here.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ("bash", "cat", "dirname", "env", "grep", "mkdir", "sed", "tail", "touch", "true")


class Machine:
    """A folder of commands, and a record of what apt-get was asked."""

    def __init__(self, folder: Path) -> None:
        self.bin = folder / "bin"
        self.asked = folder / "asked"
        self.bin.mkdir()
        self.asked.touch()
        for tool in TOOLS:
            found = shutil.which(tool)
            assert found is not None
            (self.bin / tool).symlink_to(found)
        self.add("python3", f'exec {sys.executable} "$@"')
        self.add("ldconfig", "echo libEGL.so.1 libGL.so.1")
        self.add("c++", "true")
        self.add("apt-get", f'echo "$@" >> {self.asked}')
        self.add("sudo", "exit 1")

    def add(self, name: str, script: str) -> None:
        path = self.bin / name
        path.unlink(missing_ok=True)
        path.write_text(f"#!/bin/bash\n{script}\n")
        path.chmod(0o755)

    def remove(self, name: str) -> None:
        (self.bin / name).unlink()

    def ensure(self, *, root: bool = True) -> subprocess.CompletedProcess[str]:
        """Run ensure_system_packages, then say that life goes on."""
        script = f"""
            set -euo pipefail
            source {ROOT}/script/lib/house.sh
            ROOT={self.bin.parent}
            is_root() {{ {"true" if root else "false"}; }}
            ensure_system_packages
            echo went on
        """
        command = [str(self.bin / "bash"), "-c", script, "script/test"]
        # Without the caller's CXX and PYTHON: the stand-ins are all there is.
        return subprocess.run(command, env={"PATH": str(self.bin)}, capture_output=True, text=True)


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_complete_machine_is_left_alone_silently(machine: Machine) -> None:
    done = machine.ensure()
    assert (done.returncode, done.stdout, done.stderr) == (0, "went on\n", "")
    assert machine.asked.read_text() == ""


def test_root_installs_exactly_what_is_missing(machine: Machine) -> None:
    machine.add("apt-get", f'echo "$@" >> {machine.asked}; echo > {machine.bin}/egl')
    machine.add("ldconfig", f"[[ ! -e {machine.bin}/egl ]] || echo libEGL.so.1; echo libGL.so.1")
    done = machine.ensure()
    assert done.returncode == 0, done.stderr
    assert done.stderr == "Installing system packages: libegl1\n"
    update, install = machine.asked.read_text().splitlines()
    assert update.endswith(" update")
    assert install.endswith(" install -y --no-install-recommends libegl1")


def test_without_root_the_packages_are_named_and_the_status_is_3(machine: Machine) -> None:
    machine.remove("c++")
    machine.add("ldconfig", "true")
    done = machine.ensure(root=False)
    assert (done.returncode, done.stdout) == (3, "")
    assert "These packages are missing: g++ libegl1 libgl1\n" in done.stderr
    assert "sudo apt-get update && sudo apt-get install" in done.stderr
    assert machine.asked.read_text() == ""


def test_sudo_without_password_installs(machine: Machine) -> None:
    machine.remove("c++")
    machine.add("sudo", 'shift; exec "$@"')
    done = machine.ensure(root=False)
    assert machine.asked.read_text().splitlines()[1].endswith(" g++")
    # The stand-in installs nothing, so the compiler is still missing: said, not passed over.
    assert done.returncode == 3
    assert "a C++20 compiler" in done.stderr


def test_failed_install_shows_what_apt_said(machine: Machine) -> None:
    machine.remove("c++")
    machine.add("apt-get", "echo E: no space left; exit 100")
    done = machine.ensure()
    assert done.returncode == 3
    assert "E: no space left" in done.stderr
    assert "could not install: g++" in done.stderr


def test_machine_without_python_gets_it_with_headers_and_venv(machine: Machine) -> None:
    machine.remove("python3")
    done = machine.ensure(root=False)
    assert "missing: python3 python3-venv python3-dev\n" in done.stderr


def test_old_python_is_refused_before_anything_is_installed(machine: Machine) -> None:
    machine.remove("c++")
    machine.add("python3", '[[ "$1" != -V ]] || echo Python 3.9.2; exit 1')
    done = machine.ensure()
    assert done.returncode == 3
    assert "Python 3.9.2 at" in done.stderr
    assert "3.11 or newer" in done.stderr
    assert machine.asked.read_text() == ""


def test_other_system_without_a_compiler_is_told_what_to_provide(machine: Machine) -> None:
    machine.remove("apt-get")
    machine.remove("c++")
    done = machine.ensure()
    assert done.returncode == 3
    assert "a C++20 compiler" in done.stderr
    assert "libEGL" not in done.stderr


def test_other_system_without_opengl_only_goes_on(machine: Machine) -> None:
    machine.remove("apt-get")
    machine.add("ldconfig", "true")
    done = machine.ensure()
    assert (done.returncode, done.stdout) == (0, "went on\n")
    assert "libEGL.so.1" in done.stderr


def without_openvdb(machine: Machine) -> None:
    """A compiler that does not find its headers, until apt-get has installed something."""
    machine.add("c++", f"[[ -e {machine.bin}/openvdb ]]")
    machine.add(
        "apt-get",
        f'echo "$@" >> {machine.asked}; [[ "$*" != *install* ]] || echo > {machine.bin}/openvdb',
    )


def test_openvdb_is_installed_where_that_takes_no_question(machine: Machine) -> None:
    without_openvdb(machine)
    assert machine.ensure().returncode == 0
    install = machine.asked.read_text().splitlines()[1]
    assert install.endswith(" --no-install-recommends libopenvdb-dev libboost-iostreams-dev")
    machine.ensure()
    assert len(machine.asked.read_text().splitlines()) == 2


def test_openvdb_is_not_asked_for_without_root(machine: Machine) -> None:
    without_openvdb(machine)
    done = machine.ensure(root=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "went on\n", "")
    assert machine.asked.read_text() == ""


def test_openvdb_that_cannot_be_had_stops_nothing_and_is_tried_once(machine: Machine) -> None:
    machine.add("c++", "false")
    machine.add("apt-get", f'echo "$@" >> {machine.asked}; exit 100')
    done = machine.ensure()
    assert (done.returncode, done.stdout) == (0, "went on\n")
    assert "Going on without OpenVDB" in done.stderr
    assert machine.ensure().stderr == ""
    assert len(machine.asked.read_text().splitlines()) == 2
