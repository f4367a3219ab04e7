"""Carries out a Containerfile in debootstrap roots: see script/try-image, which is the command."""

from __future__ import annotations

import argparse
import fnmatch
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import tree_rules
from containerfile import Instruction, Stage, parse
from image_run import serve_and_ask

ROOT = Path(__file__).resolve().parents[2]
CONTAINERFILE = ROOT / "deploy" / "Containerfile"
SUITES = {"12": "bookworm", "13": "trixie"}

# How this machine reaches its registries; a container engine gives its builds the same.
OF_THE_MACHINE = (
    *("/etc/apt/sources.list", "/etc/apt/sources.list.d", "/etc/apt/auth.conf.d"),
    *("/etc/apt/apt.conf.d", "/etc/pip.conf", "/etc/resolv.conf", "/etc/hosts"),
    *("/etc/ssl/certs", "/usr/local/share/ca-certificates"),
)
PASSED = ("PIP_", "SSL_CERT", "REQUESTS_CA", "CURL_CA", "http", "HTTP", "no_proxy", "NO_PROXY")


class Builder:
    """Makes the roots of stages in a folder; a stage that others need is made once."""

    def __init__(self, stages: list[Stage], folder: Path) -> None:
        self._stages = {stage.name: stage for stage in stages}
        self._folder = folder
        self.environments: dict[str, dict[str, str]] = {}
        self.last: dict[str, dict[str, Instruction]] = {}  # of each stage and name, the last one

    def root(self, name: str) -> Path:
        """The root of a stage, built if it is not yet."""
        root = self._folder / name
        if name in self.environments:
            return root
        stage = self._stages[name]
        if stage.base in self._stages:
            base = self.root(stage.base)
            self.environments[name] = dict(self.environments[stage.base])
            self.last[name] = dict(self.last[stage.base])
        else:
            base = self._debian(stage.base)
            self.environments[name] = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin"}
            self.last[name] = {}
        say(f"== stage {name}, from {stage.base}")
        subprocess.run(["cp", "-a", "--reflink=auto", str(base), str(root)], check=True)
        for step in stage.instructions:
            self._take(stage, step, root)
        return root

    def _take(self, stage: Stage, step: Instruction, root: Path) -> None:
        say(f"   {step.name} {step.text[:100]}")
        self.last[stage.name][step.name] = step
        if step.name == "RUN":
            self._run(stage, step, root)
        elif step.name == "COPY":
            self._copy(step, root)
        elif step.name == "ENV":
            self.environments[stage.name] |= step.pairs()

    def _run(self, stage: Stage, step: Instruction, root: Path) -> None:
        passed = {k: v for k, v in os.environ.items() if k.startswith(PASSED)}
        environment = {**passed, **self.environments[stage.name]}
        mounted = [(["-t", "proc", "proc"], "proc"), (["--bind", "/dev"], "dev")]
        for arguments, place in mounted:
            subprocess.run(["mount", *arguments, str(root / place)], check=True)
        try:
            command = ["chroot", str(root), "/bin/sh", "-c", step.text]
            start = time.monotonic()
            with (self._folder / "run.log").open("wb") as log:
                done = subprocess.run(command, env=environment, stdout=log, stderr=log)
            if done.returncode != 0:
                tail = (self._folder / "run.log").read_text(errors="replace")[-2000:]
                raise SystemExit(f"line {step.line}: RUN ended with {done.returncode}:\n{tail}")
            say(f"      {time.monotonic() - start:.0f} s")
        finally:
            for _, place in mounted:
                subprocess.run(["umount", str(root / place)], check=True)

    def _copy(self, step: Instruction, root: Path) -> None:
        words = step.words()
        flags = dict(w.removeprefix("--").split("=", 1) for w in words if w.startswith("--"))
        source, destination = [word for word in words if not word.startswith("--")]
        if set(flags) - {"from"}:
            raise SyntaxError(f"line {step.line}: COPY with {flags} is not known here")
        to = root / destination.lstrip("/")
        to.parent.mkdir(parents=True, exist_ok=True)
        if "from" in flags:
            origin = self.root(flags["from"]) / source.lstrip("/")
            subprocess.run(["cp", "-a", f"{origin}/.", str(to)], check=True)
        elif source == ".":
            for path in context_files():
                (to / path).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / path, to / path)
        else:
            shutil.copy2(ROOT / source, to)

    def _debian(self, image: str) -> Path:
        """A minimal Debian, as the image `debian` is made."""
        suite = SUITES[image.removeprefix("debian:").partition(".")[0]]
        root = self._folder / f"debian-{suite}"
        if not (root / "etc" / "complete").exists():
            shutil.rmtree(root, ignore_errors=True)
            say(f"== debootstrap {suite}")
            command = ["debootstrap", "--variant=minbase", suite, str(root), mirror()]
            with (self._folder / "debootstrap.log").open("wb") as log:
                subprocess.run(command, check=True, stdout=log, stderr=log)
            use_registries_of_the_machine(root)
            (root / "etc" / "complete").touch()
        return root


def context_files() -> list[Path]:
    """The tree less what .dockerignore names, as a build sees it."""
    lines = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    ignored = [line.removeprefix("**/") for line in lines if line and not line.startswith("#")]

    def is_ignored(path: str) -> bool:
        parts = path.split("/")
        ends = ["/".join(parts[: i + 1]) for i in range(len(parts))]
        return any(fnmatch.fnmatch(name, rule) for rule in ignored for name in (*ends, *parts))

    return [Path(str(p)) for p in tree_rules.tree_files(ROOT) if not is_ignored(str(p))]


def mirror() -> str:
    """Where this machine takes Debian packages from."""
    found = [*Path("/etc/apt/sources.list.d").glob("*.sources"), Path("/etc/apt/sources.list")]
    for line in "\n".join(path.read_text() for path in found if path.exists()).splitlines():
        words = line.split()
        if words[:1] in (["URIs:"], ["deb"]):
            return next(word for word in words[1:] if not word.startswith("["))
    return "http://deb.debian.org/debian"


def use_registries_of_the_machine(root: Path) -> None:
    """Give a root this machine's way to its registries."""
    (root / "etc/apt/sources.list").unlink(missing_ok=True)
    for name in map(Path, OF_THE_MACHINE):
        place = root / str(name).lstrip("/")
        if name.is_dir():
            shutil.copytree(name, place, dirs_exist_ok=True)
        elif name.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(name, place)
    for source in (root / "etc/apt/sources.list.d").glob("*"):
        if "debian" not in source.name:
            source.unlink()


def say(text: str) -> None:
    """One line of progress."""
    print(text, file=sys.stderr, flush=True)


def main() -> None:
    """Build the target's root, serve from it, ask for a picture."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--target", default="cpu", help="the stage to try")
    parser.add_argument("--keep", action="store_true", help="leave the roots in place")
    parser.add_argument("--folder", type=Path, default=Path("/var/tmp/octobrick-image"))
    arguments = parser.parse_args()
    folder = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for stage in parse(CONTAINERFILE):
        shutil.rmtree(folder / stage.name, ignore_errors=True)
    builder = Builder(parse(CONTAINERFILE), folder)
    try:
        root = builder.root(arguments.target)
        serve_and_ask(
            root, builder.environments[arguments.target], builder.last[arguments.target], ROOT
        )
    finally:
        if not arguments.keep:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
