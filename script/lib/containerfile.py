"""A Containerfile as stages of instructions: as much of the format as ours uses, no more."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

KNOWN = {"COPY", "RUN", "ENV", "LABEL", "USER", "EXPOSE", "STOPSIGNAL", "HEALTHCHECK"}
KNOWN |= {"ENTRYPOINT", "CMD"}


@dataclass(frozen=True)
class Instruction:
    """One instruction: its name, its text with continued lines joined, where it begins."""

    name: str
    text: str
    line: int

    def words(self) -> list[str]:
        """The text as a list: JSON where it is JSON, else as a shell would split it."""
        if self.text.startswith("["):
            words = json.loads(self.text)
            if not (isinstance(words, list) and all(isinstance(word, str) for word in words)):
                raise SyntaxError(f"line {self.line}: not a list of strings: {self.text}")
            return words
        return shlex.split(self.text)

    def pairs(self) -> dict[str, str]:
        """NAME=VALUE words, as ENV and LABEL have them."""
        split = [word.partition("=") for word in self.words()]
        return {name: value for name, _, value in split}


@dataclass(frozen=True)
class Stage:
    """What lies between two FROM lines."""

    name: str
    base: str  # an image, or the name of an earlier stage
    instructions: list[Instruction] = field(default_factory=list)


def parse(path: Path) -> list[Stage]:
    """The stages of a Containerfile, with the defaults of its ARGs put in.

    Raises:
        SyntaxError: an instruction that this parser does not know, or one out of place.
    """
    arguments: dict[str, str] = {}
    stages: list[Stage] = []
    for step in _instructions(path.read_text(encoding="utf-8")):
        if step.name == "ARG" and not stages:
            name, _, value = step.text.partition("=")
            arguments[name] = value
        elif step.name == "FROM":
            match = re.fullmatch(r"(\S+)\s+AS\s+(\S+)", step.text)
            if match is None:
                raise SyntaxError(f"line {step.line}: a stage needs a name: FROM {step.text}")
            base = re.sub(r"\$\{(\w+)\}", lambda found: arguments[found[1]], match[1])
            stages.append(Stage(match[2], base))
        elif step.name in KNOWN and stages:
            stages[-1].instructions.append(step)
        else:
            raise SyntaxError(f"line {step.line}: {step.name} is not known here")
    return stages


def _instructions(text: str) -> Iterator[Instruction]:
    joined, begin = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("#") or (not joined and not line.strip()):
            continue
        begin = begin if joined else number
        continued = line.endswith("\\")
        joined += line.removesuffix("\\")
        if continued:
            continue
        name, _, rest = joined.strip().partition(" ")
        yield Instruction(name.upper(), rest.strip(), begin)
        joined = ""
    if joined:
        raise SyntaxError(f"line {begin}: the last line goes on nowhere")
