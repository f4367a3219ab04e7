"""The commands that make and show what is recommended, as a shell takes them."""

from __future__ import annotations

import shlex

from octobrick.measure.measurement import Setting
from octobrick.measure.reference import Reference, ingestible


def volume_name(reference: Reference) -> str:
    """Of the folder that the recommended ingest makes; not that of what was measured."""
    suffix = "" if reference.volume is None else "-measured"
    return f"{reference.name}{suffix}.zarr"


def ingest_command(reference: Reference, setting: Setting, *, gradients: bool = False) -> str:
    """`octobrick ingest` with all that says how the source is read, and how it is stored."""
    words = ["octobrick", "ingest", *reference.options.flags(), *setting.flags]
    if gradients:
        words.append("--gradients")
    # Names come last, where one that begins with a dash is none of the options.
    given = ingestible(reference)
    words += ["--"] if given.startswith("-") else []
    return shlex.join([*words, given, volume_name(reference)])


def render_command(reference: Reference, flags: tuple[str, ...]) -> str:
    """`octobrick render` of that volume."""
    name = volume_name(reference)
    picture = name.removesuffix(".zarr") + ".png"
    return shlex.join(["octobrick", "render", name, "-o", picture, *flags])
