"""Every extreme that octobrick is held to: which systems it may upset, and what they must do.

A row names an extreme, and for each system the implementations that have to bear it: "numpy" is the
slow reference, "cpp" what users call, "glsl" shaders that fill a slab, "direct" shaders that sample
codes without one, "store" volumes on disk, "server" the service. For every (row, system,
implementation) there is a test here, by `holds`, or one elsewhere that the row names; test_table.py
fails where there is none. What is known not to hold names its heading in docs/limitations.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

CODECS = ("numpy", "cpp", "glsl")
IMPLEMENTATIONS = ("numpy", "cpp", "glsl", "direct", "store", "server")


@dataclass(frozen=True)
class Extreme:
    """One row.

    Args:
        name: in the ids of its tests.
        title: what is extreme.
        systems: implementations by system.
        expected: what each of them does.
        elsewhere: node ids of tests outside of this folder, by "system-implementation".
        limitation: the heading in docs/limitations.md that says what does not hold.
    """

    name: str
    title: str
    systems: dict[str, tuple[str, ...]]
    expected: str
    elsewhere: dict[str, str] = field(default_factory=dict)
    limitation: str | None = None


def holds(system: str, extreme: str, *implementations: str) -> pytest.MarkDecorator:
    """Run a test once for each implementation, under ids that begin system-extreme-implementation.

    Put it next to the function, below other parameters. The test, or a fixture of it, takes
    `implementation`.
    """
    return pytest.mark.parametrize(
        "implementation",
        [
            pytest.param(
                name,
                id=f"{system}-{extreme}-{name}",
                marks=[pytest.mark.gl] if name in ("glsl", "direct") else [],
            )
            for name in implementations
        ],
    )


EVERY_CODEC = {
    "s3dc": CODECS,
    "zerobit": CODECS,
    "gradients": CODECS,
    "deblocking": CODECS,
}
CPP_ALONE = dict.fromkeys(EVERY_CODEC, ("cpp",))

EXTREMES = (
    # ---- Shapes ------------------------------------------------------------------------------
    Extreme(
        "empty-input",
        "an axis of no voxels",
        CPP_ALONE,
        "InvalidInputError that tells the shape; arrays of no vectors have codes of none",
    ),
    Extreme(
        "one-voxel",
        "1×1×1, one row, one plane, less than a block or brick",
        EVERY_CODEC | {"s3dc": (*CODECS, "direct"), "renderer": ("glsl", "store")},
        "legal; end points are those of the voxels that exist; no derivative along an axis of one; "
        "nothing to filter; a picture",
        {"renderer-store": "tests/store/test_ingest.py::test_one_voxel_is_a_volume"},
    ),
    Extreme(
        "uneven",
        "extents that neither blocks, cells, bricks nor two divide",
        EVERY_CODEC | {"s3dc": (*CODECS, "direct")},
        "grids are rounded up; every voxel keeps its promise, those at the faces too",
    ),
    # ---- Values ------------------------------------------------------------------------------
    Extreme(
        "constant",
        "blocks and volumes of one value",
        EVERY_CODEC | {"s3dc": (*CODECS, "direct"), "renderer": ("glsl",)},
        "exact; no gradient, never NaN; not moved by a filter; ambient light only",
    ),
    Extreme(
        "full-range",
        "the whole range of uint8, int8, uint16 and int16 in one block",
        EVERY_CODEC | {"s3dc": (*CODECS, "direct")},
        "no difference wraps; the bound holds",
    ),
    Extreme(
        "wide-integers",
        "integers of 32 bits",
        CPP_ALONE | {"renderer": ("store",)},
        "refused by type, never wrapped; ingest converts where it is asked to and values fit",
        {
            "renderer-store": "tests/store/test_ingest_kinds.py::"
            "test_conversion_keeps_values_that_fit_and_refuses_others_by_position"
        },
        "Types of 32 and 64 bits have no code",
    ),
    Extreme(
        "greatest-floats",
        "float32 ±3.4e38 in one block",
        EVERY_CODEC | {"s3dc": (*CODECS, "direct")},
        "max − min does not overflow; end points exact, all else finite and within the bound",
    ),
    Extreme(
        "denormals",
        "float32 voxels of a few 2^−149",
        EVERY_CODEC,
        "as exact as other numbers in numpy, in C++ and on llvmpipe; a GPU may take them for 0",
        limitation="Denormal numbers may count as 0 on a GPU",
    ),
    Extreme(
        "signed-zero",
        "−0 beside +0",
        EVERY_CODEC,
        "one value: decodes as +0, its sign gives no direction and moves nothing",
    ),
    Extreme(
        "not-finite",
        "NaN and ±Inf",
        CPP_ALONE | {"renderer": ("glsl", "store", "server")},
        "refused by the voxel's place, or replaced where it was said by what; cameras and queries "
        "that are not finite are refused; no answer holds NaN",
        {
            "renderer-store": "tests/store/test_ingest.py::"
            "test_a_value_that_is_not_finite_is_refused_with_its_position",
            "renderer-server": "tests/server/test_render.py::"
            "test_senseless_query_is_422_and_names_the_word",
        },
        "NaN and infinity are never stored",
    ),
    Extreme(
        "tiny-range",
        "a range of a few float32 steps on an offset of 1e8",
        {"s3dc": CODECS, "deblocking": CODECS},
        "the bound, and one rounding to float32; filtered voxels stay between least and greatest",
        limitation="A narrow range on a large offset has no more steps than float32 has",
    ),
    # ---- S3Dc --------------------------------------------------------------------------------
    Extreme(
        "one-bit",
        "one bit an index",
        {"s3dc": (*CODECS, "direct"), "deblocking": CODECS},
        "the ends of each block and nothing between; 8-bit samples off by 128 at most",
    ),
    Extreme(
        "eight-bits",
        "eight bits an index",
        {"s3dc": (*CODECS, "direct")},
        "8-bit samples are exact",
    ),
    Extreme(
        "bounds",
        "max_error 0, and beyond any range",
        {"s3dc": CODECS},
        "0 is lossless; a bound beyond the range costs no bits; neither is ever exceeded",
    ),
    # ---- Zerobit -----------------------------------------------------------------------------
    Extreme(
        "ratio-ends",
        "a ratio of 0 and of 1",
        {"zerobit": CODECS},
        "averages alone; all details, off by their rounding and their codewords",
        limitation="Zerobit has no bound of its error",
    ),
    Extreme(
        "void-and-noise",
        "nothing but background, nothing but noise",
        {"zerobit": CODECS},
        "a byte a unit block; at most 640 bytes of ZSMS and 4032 of DIS in one",
    ),
    Extreme(
        "colours",
        "up to 256 different cells, and more",
        {"zerobit": CODECS},
        "exact; or by a codeword near them",
    ),
    Extreme(
        "low-averages",
        "averages that rank below every detail",
        {"zerobit": CODECS},
        "cells never turn to background, unless averages are counted on purpose",
    ),
    # ---- Gradients ---------------------------------------------------------------------------
    Extreme(
        "no-gradients",
        "no gradient anywhere, or a single one",
        {"gradients": CODECS},
        "(0, 0, 0) has its own code, and reduces to itself; the single one wins entirely",
    ),
    Extreme(
        "magnitudes",
        "vectors from 5e-324 to 1e308 long",
        {"gradients": CODECS},
        "0.1731° whatever the length",
    ),
    Extreme(
        "region-borders",
        "directions on the borders of the code's 48 regions",
        {"gradients": CODECS},
        "0.1731°; equal components decode to equal ones, whichever comes first",
    ),
    # ---- Deblocking --------------------------------------------------------------------------
    Extreme(
        "strengths",
        "λ of 0, 1e-300, 1e2, 1e4, 1e300 and negative",
        {"deblocking": CODECS},
        "finite, between least and greatest voxel, moved by no more than the bound",
    ),
    # ---- Renderer: transfer functions --------------------------------------------------------
    Extreme(
        "empty-function",
        "a transfer function without opacity",
        {"renderer": ("glsl",)},
        "nothing is read or uploaded; the background exactly",
        {
            "renderer-glsl": "tests/renderer/test_gl_pictures.py::"
            "test_empty_transfer_function_leaves_the_background_exactly"
        },
    ),
    Extreme(
        "opaque-function",
        "a transfer function that is opaque everywhere",
        {"renderer": ("glsl", "direct")},
        "alpha of 1 wherever the volume is, and slabs behind are not decoded",
    ),
    Extreme(
        "spike-function",
        "opacity in a spike between two values, narrower than a step of the code",
        {"renderer": ("glsl",)},
        "what is dropped by its range changes no pixel",
    ),
    # ---- Renderer: views ---------------------------------------------------------------------
    Extreme(
        "camera-inside",
        "the eye inside the volume, on a face, on a corner",
        {"renderer": ("glsl", "direct")},
        "finite, and the opacity of what lies ahead",
    ),
    Extreme(
        "looking-away",
        "the volume behind the eye",
        {"renderer": ("glsl",)},
        "the background, nothing read",
        {
            "renderer-glsl": "tests/renderer/test_gl_pictures.py::"
            "test_camera_that_looks_away_sees_the_background"
        },
    ),
    Extreme(
        "parallel-rays",
        "rays parallel to faces, within them and beside them (0 · ∞)",
        {"renderer": ("glsl", "direct")},
        "finite; the length within the volume, 0 beside it",
    ),
    Extreme(
        "one-voxel-zoom",
        "one voxel fills the picture",
        {"renderer": ("glsl",)},
        "its value interpolated smoothly; at 10^6 still the value at the target",
    ),
    Extreme(
        "field-of-view",
        "angles of view near 0° and 180°",
        {"renderer": ("glsl",)},
        "finite pictures of what lies ahead, from 1e-6° to 179.999°; 0 and 180 are refused",
        limitation="Above 179.999° the middle of a picture is off",
    ),
    Extreme(
        "anisotropic",
        "voxels up to a thousand times longer than wide",
        {"gradients": ("numpy", "cpp", "glsl"), "renderer": ("glsl",)},
        "gradients, steps and proportions count in world units",
    ),
    # ---- Renderer: how it is made ------------------------------------------------------------
    Extreme(
        "step-size",
        "steps from 1/64 of a voxel to 4",
        {"renderer": ("glsl", "direct")},
        "opacity follows the length of the way, not the number of steps, to 1e-3 of it",
        limitation="What is thinner than a step can be missed",
    ),
    Extreme(
        "slab-cuts",
        "slabs cut through blocks, samples and anything; a volume less than one slab",
        {"renderer": ("glsl",), "deblocking": ("glsl",)},
        "the same picture: 1e-5 of premultiplied colours, and the same texels",
        {
            "deblocking-glsl": "tests/renderer/test_gl_deblocking.py::"
            "test_slabs_cut_anywhere_have_the_texels_of_the_whole"
        },
    ),
    Extreme(
        "early-end",
        "rays that end before all is gathered",
        {"renderer": ("glsl",)},
        "at most 0.01 is missing of what is behind; ours end at 1 − 1/1024",
    ),
    Extreme(
        "threads-and-instructions",
        "any number of threads, with and without SIMD",
        {**CPP_ALONE, "renderer": ("glsl",)},
        "the same bits",
    ),
    # ---- Volumes and service -----------------------------------------------------------------
    Extreme(
        "corrupt-step",
        "a time series of which one step is damaged",
        {"renderer": ("glsl", "store", "server")},
        "CorruptBrickError of that step, no crash; all others as before",
        {
            "renderer-server": "tests/server/test_bricks.py::"
            "test_damaged_brick_is_an_error_of_its_own_and_the_rest_is_served"
        },
    ),
    Extreme(
        "beyond-the-levels",
        "a brick, level or step that there is not",
        {"renderer": ("glsl", "store", "server")},
        "a typed error that tells how many there are",
        {
            "renderer-store": "tests/store/test_volume.py::"
            "test_a_brick_that_does_not_exist_is_refused_with_what_does",
            "renderer-server": "tests/server/test_bricks.py::test_what_the_volume_lacks_is_404",
        },
    ),
    Extreme(
        "read-while-writing",
        "reading a volume while it is written anew",
        {"renderer": ("store",)},
        "what was open stays as it was or says that it is gone; nothing half made is seen",
    ),
)
