"""Procedural volumes of any size, as streams of planes: for tests, benchmarks and trials.

Any piece can be made alone and equals the same piece of the whole; memory is bounded by a few
planes, whatever the size of the volume.
"""

from octobrick.store.synth.kinds import KINDS, SYNTH_DTYPES, planes
from octobrick.store.synth.result import SynthResult
from octobrick.store.synth.write import synth

__all__ = ["KINDS", "SYNTH_DTYPES", "SynthResult", "planes", "synth"]
