"""Bricks that stand for all: chosen by strata of range and entropy, each with its weight.

A volume that is mostly air has mostly bricks that every code keeps nearly for nothing. Were bricks
chosen evenly, few would tell what the code does to the rest, and figures would depend on chance.
So bricks are put into strata by how far their values reach and how evenly they are spread; each
stratum gives as many bricks as any other, evenly over their entropies; and each brick counts for as
many voxels as its stratum has for each that was chosen. Weighted figures so stand for the whole,
air included.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.measure.brick_pass import BrickKey, BrickPass, brick_box
from octobrick.measure.reference import Reference
from octobrick.measure.scan import BrickFacts, Scan
from octobrick.store.box import Box

Voxels = NDArray[np.generic]

NBRICKS = 24
"""How many bricks are chosen: of each most codes take a twentieth of a second, some a fifth."""

_CLASSES = 3  # of range, and of entropy within each
_FLAT_BRICKS = 2  # chosen of those of one value, which hardly differ
_GROUP_BRICKS = 64  # in memory at once, where all are taken


@dataclass(frozen=True, slots=True)
class Stratum:
    """Bricks that are alike.

    Attributes:
        name: for people: "flat", or which third of range and of entropy.
        nbricks: that were looked at.
        share: of the voxels that were looked at.
        chosen: how many of them are measured.
    """

    name: str
    nbricks: int
    share: float
    chosen: int


@dataclass(frozen=True, slots=True)
class SampleBrick:
    """A brick to measure.

    Attributes:
        voxels: its own, without padding.
        weight: it counts so many times.
        box: where it lies in the volume.
    """

    voxels: Voxels
    weight: float
    box: Box


@dataclass(frozen=True, slots=True)
class Sample:
    """Which bricks are measured, and what each stands for.

    Attributes:
        strata: of all bricks that were looked at; none where all are measured.
        weights: of the chosen bricks. Times their voxels they add up to those of level 0.
    """

    strata: tuple[Stratum, ...]
    weights: dict[BrickKey, float]

    @classmethod
    def of(cls, scan: Scan, seed: int, *, full: bool, nbricks: int = NBRICKS) -> Sample:
        """A choice that depends on nothing but the bricks and the seed.

        Args:
            scan: what there is to choose from.
            seed: of the choice within strata.
            full: take every brick, with a weight of 1.
            nbricks: about how many to choose otherwise.
        """
        if full or (scan.whole and len(scan.bricks) <= nbricks):
            return cls((), {brick.key: 1.0 for brick in scan.bricks})
        chance = np.random.default_rng(seed)
        classes = stratified(scan.bricks)
        counts = _shared_out(
            nbricks,
            [
                min(len(bricks), _FLAT_BRICKS) if name == "flat" else len(bricks)
                for name, bricks in classes.items()
            ],
        )
        seen_nvoxels = sum(brick.nvoxels for brick in scan.bricks)
        strata, weights = [], {}
        for (name, bricks), count in zip(classes.items(), counts, strict=True):
            # Evenly over the stratum, whose bricks are in the order of their entropy.
            places = (np.arange(count) + chance.random()) * (len(bricks) / count)
            chosen = [bricks[i] for i in places.astype(int)]
            own = sum(brick.nvoxels for brick in bricks)
            weight = own / sum(brick.nvoxels for brick in chosen) * scan.nvoxels / seen_nvoxels
            weights.update({brick.key: weight for brick in chosen})
            strata.append(Stratum(name, len(bricks), own / seen_nvoxels, count))
        return cls(tuple(strata), weights)

    def groups(
        self, reference: Reference, scan: Scan, executor: Executor
    ) -> Iterator[list[SampleBrick]]:
        """The bricks with their voxels, in the order of reading, some at a time."""
        keys = set(self.weights)
        # Places behind the last that is wanted are not read; keys say a place by its number.
        last = max((key.place for key in keys), default=-1)
        replacement = reference.options.replace_nonfinite
        run = BrickPass(reference.source, scan.places[: last + 1], replacement, executor)
        passing = run.run(keys.__contains__, keep=True)
        group: list[SampleBrick] = []
        for key, seen in passing:
            keys.discard(key)
            box = brick_box(scan.places, key)
            group.append(SampleBrick(seen.voxels, self.weights[key], box))
            if len(group) == _GROUP_BRICKS or not keys:
                yield group
                group = []
            if not keys:
                passing.close()
                return

    def to_dict(self, scan: Scan) -> dict[str, Any]:
        """How much stands for how much, JSON-ready."""
        nvoxels = {brick.key: brick.nvoxels for brick in scan.bricks}
        return {
            "bricks": len(self.weights),
            "bricks_seen": len(scan.bricks),
            "bricks_of_level_0": scan.nbricks,
            "share_of_voxels": sum(nvoxels[key] for key in self.weights) / scan.nvoxels,
            "strata": [
                {
                    "name": stratum.name,
                    "bricks": stratum.nbricks,
                    "share_of_voxels": stratum.share,
                    "chosen": stratum.chosen,
                }
                for stratum in self.strata
            ],
        }


def stratified(bricks: Iterable[BrickFacts]) -> dict[str, list[BrickFacts]]:
    """Bricks by stratum: those of one value, then thirds of range, and in each of entropy.

    No stratum is empty, so there may be fewer.
    """
    classes: dict[str, list[BrickFacts]] = defaultdict(list)
    varied = []
    for brick in bricks:
        if brick.range == 0:
            classes["flat"].append(brick)
        else:
            varied.append(brick)
    words = ("low", "middle", "high")
    for i, third in enumerate(_parts(varied, [brick.range for brick in varied])):
        by_entropy = _parts(third, [brick.entropy_bits for brick in third])
        for j, part in enumerate(by_entropy):
            classes[f"{words[i]} range, {words[j]} entropy"] = part
    return dict(classes)


def _parts(bricks: list[BrickFacts], values: list[float]) -> list[list[BrickFacts]]:
    """Bricks by rank of their values, as many in each part; ties in the order of reading."""
    order = np.argsort(values, kind="stable")
    parts = [[bricks[i] for i in part] for part in np.array_split(order, _CLASSES)]
    return [part for part in parts if part]


def _shared_out(total: int, sizes: list[int]) -> list[int]:
    """As many for each, at least one, none more than it has; what is over goes to the others."""
    counts = [0] * len(sizes)
    left = max(total, len(sizes))
    while left > 0 and any(count < size for count, size in zip(counts, sizes, strict=True)):
        open_ = [i for i, size in enumerate(sizes) if counts[i] < size]
        each = max(left // len(open_), 1)
        for i in open_[: max(left, 0)]:
            more = min(each, sizes[i] - counts[i])
            counts[i] += more
            left -= more
    return counts
