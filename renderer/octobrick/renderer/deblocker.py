"""The deblocking filter on the GPU: decoded, and smoothed across the borders of blocks.

What docs/spec/deblocking.md defines, with `axes="average"`, blocks, bounds and limits as
`octobrick.codec.deblock.deblocked` chooses them. Passes: decode, with the margin that the filter
reads; bounds of the blocks; weights of the voxels; the curves along each axis; the limited result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from octobrick.codec import S3dc
from octobrick.codec.errors import UnsupportedError
from octobrick.renderer.bezier_curve import BezierCurve
from octobrick.renderer.brick_codes import BrickCodes
from octobrick.renderer.brick_pool import BrickPool, Resident
from octobrick.renderer.code_layout import CodeLayout, Values, xyz_text
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.filter_margin import block_box, filtered_box
from octobrick.renderer.scratch_textures import ScratchTextures
from octobrick.renderer.slab_decoder import Kernel, SlabDecoder, Target
from octobrick.renderer.slab_filler import Filled
from octobrick.renderer.slab_format import FLOATS, SlabFormat
from octobrick.renderer.uniforms import run_over, set_uniforms
from octobrick.store.box import Box, Zyx, ceil_div

if TYPE_CHECKING:
    import moderngl

OUTPUTS_MAX: Final = 8
"""Points of a curve that one invocation finds: it reads the control points once for them all."""
COARSE_BITS_MAX: Final = 2
"""Up to so many bits a block's range is at most ten bounds, so the limit is a clamp."""
STRENGTH_LARGEST: Final = 1e38
"""More is the same in float32."""
DECODED_UNIT: Final = 0
WEIGHTS_UNIT: Final = 1
BOUNDS_UNIT: Final = 1
FIRST_IMAGE: Final = 0
SECOND_IMAGE: Final = 1


@dataclass(frozen=True, slots=True)
class FilteredVolume:
    """What the filter must know of a level.

    Attributes:
        codes: its bricks.
        level_shape_zyx: its voxels: the filter is defined on these, not on padded bricks.
        value_range: of the volume, which gradients are measured against.
    """

    codes: BrickCodes
    level_shape_zyx: Zyx
    value_range: tuple[float, float]

    @property
    def layout(self) -> CodeLayout:
        """Of the codes."""
        return self.codes.layout

    @property
    def stored_per_range(self) -> float:
        """The volume's range in the units of the passes: values of integers, stored of floats."""
        low, high = (float(bound) for bound in self.value_range)
        return high - low if self.layout.sample.kind != "f" else 1.0


class Deblocker:
    """Fills textures with filtered voxels.

    Args:
        context: where the textures live.
        gl: the same, current in this thread.
        decoder: what decodes before.
    """

    def __init__(
        self, context: GraphicsContext, gl: moderngl.Context, decoder: SlabDecoder
    ) -> None:
        self._context = context
        self._gl = gl
        self._decoder = decoder
        self._scratch = ScratchTextures(gl)

    @property
    def scratch_nbytes(self) -> int:
        """GPU memory kept for the next slab."""
        return self._scratch.nbytes

    def release(self) -> None:
        """Free that memory."""
        self._scratch.release()

    def fill(
        self,
        volume: FilteredVolume,
        pool: BrickPool,
        target: Target,
        strength: float,
        bricks: Sequence[Zyx],
    ) -> Filled:
        """Make the target hold the filtered voxels of its box.

        Args:
            volume: what is filtered.
            pool: where its bricks are, or are brought.
            target: what is filled; of a format that has room between integers.
            strength: the filter's λ, any finite number.
            bricks: all that the box touches with the filter's margin.

        Raises:
            UnsupportedError: the blocks do not divide the bricks.
        """
        layout = volume.layout
        _require_whole_blocks(layout)
        box = filtered_box(target.box, volume.level_shape_zyx, layout.codec)
        texel = SlabFormat.of(np.dtype(layout.dtype))
        decoded = Target(
            self._scratch.require("decoded", texel, box.shape_zyx), texel, box, target.fill_stored
        )
        blocks = block_box(target.box, layout.block_zyx)
        bounds = Target(
            self._scratch.require("bounds", FLOATS, blocks.shape_zyx), FLOATS, blocks, 0.0
        )
        kernel = Kernel(self._bounds_program(volume, decoded, bounds), layout.blocks_zyx, (1, 1, 1))

        def find_bounds(batch: Sequence[Resident]) -> None:
            self._gl.memory_barrier()
            decoded.texture.use(DECODED_UNIT)
            self._decoder.run(kernel, layout, bounds, batch)

        low, high = volume.value_range
        filled = self._decoder.decode(
            volume.codes, pool, decoded, (float(low), float(high)), bricks, find_bounds
        )
        change = self._scratch.require("change", FLOATS, target.box.shape_zyx)
        self._find_change(volume, decoded, target.box, change, strength)
        self._limit(layout, decoded, bounds, change, target)
        return filled

    def _find_change(
        self,
        volume: FilteredVolume,
        decoded: Target,
        box: Box,
        change: moderngl.Texture3D,
        strength: float,
    ) -> None:
        """Three times by how much the filter moves every voxel, before it is limited."""
        strength = math.copysign(min(abs(strength), STRENGTH_LARGEST), strength)
        curves = [
            (axis, borders, curve)
            for axis in (2, 1, 0)
            for borders, curve in _curves(volume, axis, box)
        ]
        is_direct = all(curve.is_direct(strength) for _, _, curve in curves)
        weights = self._find_weights(volume, decoded, box, change, strength, is_direct=is_direct)
        decoded.texture.use(DECODED_UNIT)
        weights.use(WEIGHTS_UNIT)
        change.bind_to_image(FIRST_IMAGE, read=True, write=True)
        for axis, borders, curve in curves:
            program = self._curve_program(volume.layout, axis, curve, strength, is_direct=is_direct)
            set_uniforms(
                program,
                _places(decoded.box, box)
                | {"first_border": borders.start, "count": curve.count, "outputs": curve.noutputs},
            )
            block = volume.layout.block_zyx[axis]
            nchunks = ceil_div(block, _chunk(block))  # as the shader counts them
            across = [box.shape_zyx[a] for a in (2, 1, 0) if a != axis]
            run_over(program, (across[0], across[1], len(borders) * nchunks))
            self._gl.memory_barrier()

    def _find_weights(
        self,
        volume: FilteredVolume,
        decoded: Target,
        box: Box,
        change: moderngl.Texture3D,
        strength: float,
        *,
        is_direct: bool,
    ) -> moderngl.Texture3D:
        """exp(−λ·|∇|) of every voxel, or |∇|; and no change so far."""
        weights = self._scratch.require("weights", FLOATS, decoded.box.shape_zyx)
        program = self._context.program(
            "weights.comp.glsl", **_sample_values(volume.layout), DIRECT=is_direct
        )
        nz, ny, nx = volume.level_shape_zyx
        unit = volume.stored_per_range
        set_uniforms(
            program,
            _places(decoded.box, box)
            | {
                "decoded": DECODED_UNIT,
                "decoded_size": decoded.box.shape_zyx[::-1],
                "level_size": (nx, ny, nz),
                "gradient_scale": 1 / unit if unit > 0 else 0.0,
            }
            | ({"strength": strength} if is_direct else {}),
        )
        decoded.texture.use(DECODED_UNIT)
        weights.bind_to_image(FIRST_IMAGE, read=False, write=True)
        change.bind_to_image(SECOND_IMAGE, read=False, write=True)
        depth, height, width = decoded.box.shape_zyx
        run_over(program, (width, height, depth))
        self._gl.memory_barrier()
        return weights

    def _curve_program(
        self,
        layout: CodeLayout,
        axis_zyx: int,
        curve: BezierCurve,
        strength: float,
        *,
        is_direct: bool,
    ) -> moderngl.ComputeShader:
        block = layout.block_zyx[axis_zyx]
        chunk = _chunk(block)
        values: Values = _sample_values(layout)
        values |= {"AXIS": 2 - axis_zyx, "BLOCK": block, "OUTPUTS": chunk, "DIRECT": is_direct}
        program = self._context.program("curve.comp.glsl", **values)
        binomials, ratios = curve.direct_terms() if is_direct else curve.logarithmic_terms()
        binomials = np.pad(binomials, (0, 2 * block - len(binomials)))
        room = ceil_div(block, chunk) * chunk - len(ratios)
        ratios = np.pad(ratios, ((0, room), (0, 0)), mode="edge")
        uniforms: dict[str, Any] = {"decoded": DECODED_UNIT, "weights": WEIGHTS_UNIT}
        uniforms |= {"binomials": binomials.tolist(), "ratios": [tuple(r) for r in ratios.tolist()]}
        set_uniforms(program, uniforms | ({} if is_direct else {"strength": strength}))
        return program

    def _bounds_program(
        self, volume: FilteredVolume, decoded: Target, bounds: Target
    ) -> moderngl.ComputeShader:
        """What finds the error bounds of blocks, negative ones where the limit is a clamp."""
        layout, codec = volume.layout, volume.layout.codec
        values: Values = {"IMAGE_FORMAT": FLOATS.image, "RUN": 1, "ROWS": 1}
        values |= {"BRICK_XYZ": xyz_text(layout.brick_zyx)} | layout.sample_values()
        del values["LOWEST"], values["HIGHEST"]
        uniforms: dict[str, Any] = {}
        if isinstance(codec, S3dc):
            values |= layout.block_values()
        if layout.form == "s3dc":
            assert isinstance(codec, S3dc)
            is_ranged = bool(codec.fitted) or codec.scale != "linear"
            values |= {"RANGED": is_ranged, "IS_COARSE": layout.bits <= COARSE_BITS_MAX}
            values |= {"HIGHEST_STORED": _stored_span(layout)}
            if is_ranged:
                uniforms = {
                    "decoded": DECODED_UNIT,
                    "decoded_low": decoded.box.start_zyx[::-1],
                    "first_block": bounds.box.start_zyx[::-1],
                    "level_size": volume.level_shape_zyx[::-1],
                }
        elif layout.form == "s3dc_variable":
            assert isinstance(codec, S3dc)
            uniforms = {"bound_max": 3e38 if codec.max_error is None else codec.max_error}
        program = self._context.program(f"bounds_{layout.form}.comp.glsl", **values)
        if layout.dtype == "float32":
            uniforms["value_range"] = tuple(float(bound) for bound in volume.value_range)
        set_uniforms(program, uniforms)
        return program

    def _limit(
        self,
        layout: CodeLayout,
        decoded: Target,
        bounds: Target,
        change: moderngl.Texture3D,
        target: Target,
    ) -> None:
        """Write what remains of the changes."""
        program = self._context.program(
            "limit.comp.glsl",
            **_sample_values(layout),
            IMAGE_FORMAT=target.texel.image,
            BLOCK_XYZ=xyz_text(layout.block_zyx),
            IS_RAMP=layout.form != "s3dc",
        )
        places = _places(decoded.box, target.box)
        set_uniforms(
            program,
            places
            | {
                "decoded": DECODED_UNIT,
                "bounds": BOUNDS_UNIT,
                "first_block": bounds.box.start_zyx[::-1],
            },
        )
        decoded.texture.use(DECODED_UNIT)
        bounds.texture.use(BOUNDS_UNIT)
        target.texture.bind_to_image(FIRST_IMAGE, read=False, write=True)
        change.bind_to_image(SECOND_IMAGE, read=True, write=False)
        depth, height, width = target.box.shape_zyx
        run_over(program, (width, height, depth))
        self._gl.memory_barrier()


def _curves(volume: FilteredVolume, axis: int, box: Box) -> list[tuple[range, BezierCurve]]:
    """The borders whose curves reach into a box: those of whole blocks, and that of a cut one."""
    count, block = volume.level_shape_zyx[axis], volume.layout.block_zyx[axis]
    low = max(block, box.start_zyx[axis] // block * block)
    stop = min(box.stop_zyx[axis] + block // 2, count)
    borders = range(low, stop, block)
    whole = range(low, min(stop, count - block + 1), block)
    curves = [(whole, BezierCurve(block, block))] if whole else []
    if len(borders) > len(whole):
        curves.append((borders[len(whole) :], BezierCurve(block, count - borders[-1])))
    return [(found, curve) for found, curve in curves if curve.noutputs]


def _chunk(block: int) -> int:
    """Points that one invocation finds."""
    return min(block, OUTPUTS_MAX)


def _sample_values(layout: CodeLayout) -> Values:
    return {"IS_FLOAT": layout.sample.kind == "f", "HIGHEST_STORED": _stored_span(layout)}


def _stored_span(layout: CodeLayout) -> int:
    """What a stored 1 is in the units of the passes: the values of an integer type, less one."""
    return 1 if layout.sample.kind == "f" else 2 ** (8 * layout.sample.itemsize) - 1


def _places(decoded: Box, box: Box) -> dict[str, Any]:
    """Where in the level the first texels of the decoded voxels and of the result lie."""
    return {
        "decoded_low": decoded.start_zyx[::-1],
        "box_low": box.start_zyx[::-1],
        "box_size": box.shape_zyx[::-1],
    }


def _require_whole_blocks(layout: CodeLayout) -> None:
    if any(n % b for n, b in zip(layout.brick_zyx, layout.block_zyx, strict=True)):
        raise UnsupportedError(
            f"blocks of {layout.block_zyx} voxels do not divide bricks of {layout.brick_zyx}, so "
            "the blocks beside bricks' borders are cut, and are not filtered; render without "
            "deblocking, or ingest the volume with blocks that divide its bricks",
            block_zyx=list(layout.block_zyx),
            brick_zyx=list(layout.brick_zyx),
        )
