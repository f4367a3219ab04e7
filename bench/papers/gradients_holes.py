"""Gradients, Figure 10 and Table 1: the largest hole between codable directions, by λ.

    script/bench papers/gradients_holes [--quick] [--json FILE] [--pictures DIR]

As the paper does it: all directions that three bytes can name are triangulated on the sphere, and
the largest circle around a triangle is the hole. Of one of the 48 regions, which are alike, with
a border of its neighbours; the triangulation is Delaunay's in the plane of the stereographic
projection, which takes circles to circles. The circle's radius is how far a direction can be from
all codes; its diameter is twice that. `octobrick.codec.reference_gradients.largest_hole` finds
the same for two λ by another way, and is shown beside.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import _measure
import _paper
import numpy as np
from numpy.typing import NDArray

from octobrick.codec import reference_gradients

PUBLISHED_UNTREATED, PUBLISHED_TREATED, PUBLISHED_LEAST = 0.3177, 0.1730, 0.0615  # degrees
PUBLISHED_BEST = 0.61  # λ
BORDER = np.radians(0.8)  # of dots around the region: more than any hole
PERCENTS = sorted({*range(0, 101, 10), *range(58, 65)})
QUICK_PERCENTS = (0, 60, 61, 62)
DOTS = 2.0**24  # that three bytes could name, were all directions apart
Points = NDArray[np.float64]


def region_dots() -> NDArray[np.float32]:
    """Sorted magnitudes (a >= b >= c, odd) of one region, each direction once."""
    found = []
    for a in range(1, 256, 2):
        b, c = np.meshgrid(np.arange(1, a + 1, 2), np.arange(1, a + 1, 2), indexing="ij")
        keep = (c <= b) & (np.gcd(np.gcd(a, b), c) == 1)
        found.append(np.stack([np.full(keep.sum(), a), b[keep], c[keep]], axis=-1))
    return np.concatenate(found).astype(np.float32)


def on_sphere(dots: NDArray[np.float32], percent: int) -> Points:
    """The unit vectors that dots decode to."""
    a, b, c = dots.T
    parts = reference_gradients.transform(a, b, c, percent)
    vectors: Points = np.stack(parts, axis=-1).astype(np.float64)
    vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors


def with_border(region: Points) -> Points:
    """The region's dots and those of its neighbours that are near: mirrored, as all regions are."""
    near = region[_outside(np.negative(region)) > -2 * BORDER]
    parts = [region]
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            if order == (0, 1, 2) and signs == (1, 1, 1):
                continue
            mirrored = near[:, order] * signs
            parts.append(mirrored[_outside(mirrored) < BORDER])
    return np.concatenate(parts)


def _outside(vectors: Points) -> Points:
    """How far each is outside the region a >= b >= c >= 0 at most; of −v, how far v is inside."""
    a, b, c = vectors.T
    least: Points = np.maximum(np.maximum(b - a, c - b), -c)
    return least


def largest_hole(dots: NDArray[np.float32], percent: int) -> dict[str, float]:
    """The largest circle around a triangle whose centre is in the region, as its radius."""
    from matplotlib.tri import Triangulation

    points = with_border(on_sphere(dots, percent))
    middle = np.array([1.0, 0.45, 0.2]) / np.linalg.norm([1.0, 0.45, 0.2])
    across = np.linalg.svd(middle[np.newaxis])[2][1:]
    flat = points @ across.T / (1 + points @ middle)[:, np.newaxis]
    corners = points[Triangulation(*flat.T).triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    corners, normal, size = (x[size[:, 0] > 0] for x in (corners, normal, size))
    normal = normal / size * np.sign((normal * corners[:, 0]).sum(-1, keepdims=True))
    radius = np.degrees(
        np.arctan2(
            np.linalg.norm(np.cross(normal, corners[:, 0]), axis=-1),
            (normal * corners[:, 0]).sum(-1),
        )
    )
    radius[_outside(normal) > 1e-9] = 0
    at = int(radius.argmax())
    return {
        "lambda": percent / 100,
        "radius_degrees": float(radius[at]),
        "p": float(normal[at, 1] / normal[at, 0]),
        "q": float(normal[at, 2] / normal[at, 0]),
    }


def theoretical_least() -> float:
    """The paper's bound, a diameter: all triangles alike. In degrees."""
    side_area = 4 * np.pi / (2 * DOTS)
    return float(np.degrees(1.756 * np.sqrt(side_area)))


def run(options: Any) -> dict[str, Any]:
    dots = region_dots()
    percents = QUICK_PERCENTS if options.quick else PERCENTS
    holes = [largest_hole(dots, percent) for percent in percents]
    found = {
        "dots_of_a_region": len(dots),
        "holes": holes,
        "best_lambda": min(holes, key=lambda hole: hole["radius_degrees"])["lambda"],
        "theoretical_least_degrees": theoretical_least(),
        "reference": {
            str(percent / 100): reference_gradients.largest_hole(percent)
            for percent in (0, reference_gradients.BLEND_PERCENT)
        },
    }
    draw(found, options.pictures)
    return found


def draw(found: dict[str, Any], folder: Path) -> None:
    """Figure 10."""
    with _paper.plots(folder / "gradients-figure10", 1) as (axis,):
        at = [hole["lambda"] for hole in found["holes"]]
        axis.plot(at, [hole["radius_degrees"] for hole in found["holes"]], marker=".")
        published = ((0, PUBLISHED_UNTREATED), (PUBLISHED_BEST, PUBLISHED_TREATED))
        axis.plot(*zip(*published, strict=True), "x", color="tab:red", label="published")
        axis.set(xlabel="λ", ylabel="largest hole, degrees (radius)", title="Figure 10")
        axis.set_ylim(bottom=0)
        axis.legend()


def table(found: dict[str, Any]) -> str:
    by = {hole["lambda"]: hole for hole in found["holes"]}
    least = found["theoretical_least_degrees"]
    claims = [
        _paper.Claim("best λ", PUBLISHED_BEST, found["best_lambda"]),
        _paper.Claim("no treatment, radius °", PUBLISHED_UNTREATED, by[0.0]["radius_degrees"]),
        _paper.Claim("48 regions, radius °", PUBLISHED_TREATED, by[0.61]["radius_degrees"]),
        _paper.Claim("theoretical minimum, diameter °", PUBLISHED_LEAST, least),
        _paper.Claim("theoretical minimum, radius °", None, least / 2),
    ]
    lines = [
        [f"{h['lambda']:.2f}"] + [f"{h[k]:.5f}" for k in ("radius_degrees", "p", "q")]
        for h in found["holes"]
    ]
    reference = "; ".join(
        f"λ {k}: found {v[0]:.5f}, none above {v[1]:.5f}" for k, v in found["reference"].items()
    )
    return "\n\n".join(
        [
            f"{found['dots_of_a_region']:,} directions in each of 48 regions",
            _paper.claims_text("Table 1", claims),
            f"by the reference's search: {reference}",
            _measure.layout(["λ", "radius °", "at p", "q"], lines),
        ]
    )


def main() -> None:
    options = _paper.parser(__doc__).parse_args()
    _measure.report(options, run(options), table)


if __name__ == "__main__":
    main()
