"""Renders pictures of volumes that are larger than memory: the order of a frame's passes.

For every slab, front to back: make its bricks resident, decode them into the slab buffer, find its
empty space, cast the rays through it. docs/rendering.md tells the whole.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.budget import parse_nbytes
from octobrick.renderer.camera import Camera
from octobrick.renderer.cells import CellGrid, bricks_of
from octobrick.renderer.classifier import Classifier, ValueScale, checked_window
from octobrick.renderer.code_layout import CodeLayout
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.decoded_bricks import drawable
from octobrick.renderer.empty_space import EmptySpace
from octobrick.renderer.errors import PictureTooLargeError
from octobrick.renderer.gpu_filler import GpuFiller
from octobrick.renderer.image import (
    Background,
    Fidelity,
    RenderedImage,
    RenderStats,
    checked_background,
    finish,
)
from octobrick.renderer.lighting import Lighting
from octobrick.renderer.pass_clock import PassClock
from octobrick.renderer.raycaster import Frame, Raycaster
from octobrick.renderer.selection import (
    Selection,
    checked_level,
    finest_useful_level,
    select_bricks,
)
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_filler import Filled, SlabContent, SlabFiller
from octobrick.renderer.slab_format import SlabFormat
from octobrick.renderer.slabs import Slab, SlabPlan, plan_slabs
from octobrick.renderer.transfer_function import TransferFunction
from octobrick.renderer.view import Size, View, checked_size, make_view
from octobrick.store.box import Zyx

if TYPE_CHECKING:
    import moderngl

STEP_VOXELS_MIN, STEP_VOXELS_MAX = 1 / 64, 16.0
"""Finer steps would take minutes for nothing; coarser ones miss whole blocks."""
SLAB_SHARE = 4
"""The slab buffer takes one part in so many of the memory budget, compressed bricks the rest."""


@dataclass(frozen=True, slots=True)
class _Request:
    """The checked arguments of one call."""

    volume: BrickSource
    camera: Camera
    function: TransferFunction
    size: Size
    window: tuple[float, float]
    lighting: Lighting | None
    background: Background
    step_voxels: float
    level: int | None
    t: int
    c: int


@dataclass(frozen=True, slots=True)
class _Plan:
    """What a call will do at the level chosen."""

    level: int
    view: View
    classifier: Classifier
    selection: Selection
    slabs: SlabPlan | None  # None where there is nothing to see
    step_world: float
    reference_length_world: float


class Renderer:
    """A renderer with its own OpenGL context. Call it from any thread; calls take turns.

    Bricks stay on the GPU, compressed, between pictures. Close it, or use it in a with statement.

    Args:
        memory_budget: GPU memory for bricks and the slab buffer, as bytes or text ("512MiB").
        slab_budget: the slab buffer's part of it; by default a quarter.
        cull: False samples every brick and every step. For tests and measurements.

    Raises:
        GraphicsContextError: no OpenGL 4.5 through EGL; the message says what to install.
    """

    def __init__(
        self,
        memory_budget: int | str = "512MiB",
        *,
        slab_budget: int | str | None = None,
        cull: bool = True,
    ) -> None:
        total = parse_nbytes(memory_budget, "memory_budget")
        self._slab_nbytes = (
            total // SLAB_SHARE if slab_budget is None else parse_nbytes(slab_budget, "slab_budget")
        )
        if self._slab_nbytes >= total:
            raise InvalidInputError(
                f"slab_budget {self._slab_nbytes} leaves nothing of memory_budget {total} for "
                "compressed bricks; raise the one or lower the other"
            )
        self._cull = cull
        self._context = GraphicsContext()
        self._brick_nbytes = total - self._slab_nbytes
        with self._context.current() as gl:
            self._filler: SlabFiller = GpuFiller(self._context, gl, self._brick_nbytes)
            self._slab = SlabBuffer(self._context, gl)
            self._empty_space = EmptySpace(self._context, gl)
            self._raycaster = Raycaster(self._context, gl)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the context and all GPU memory. Idempotent."""
        self._context.release()

    def forget_bricks(self) -> None:
        """Free the GPU memory of all bricks and of the slab; the next picture loads its own."""
        with self._context.current():
            self._filler.forget()
            self._slab.release_texture()
            self._empty_space.forget()

    @property
    def gl_renderer(self) -> str:
        """The driver's name of the device."""
        return self._context.renderer_name

    def render(
        self,
        volume: BrickSource,
        camera: Camera,
        transfer_function: TransferFunction,
        size: tuple[int, int] = (768, 768),
        *,
        window: tuple[float, float] | None = None,
        shading: bool | Lighting = True,
        background: Sequence[float] | None = (0.0, 0.0, 0.0),
        step_voxels: float = 0.5,
        level: int | None = None,
        t: int = 0,
        c: int = 0,
    ) -> RenderedImage:
        """A picture of a volume.

        Args:
            volume: an `octobrick.store.Volume`, or anything that fits `BrickSource`.
            camera: where from.
            transfer_function: which colour and opacity a value has.
            size: (width, height) in pixels.
            window: values at relative positions 0 and 1; None takes the volume's.
            shading: light surfaces by their gradient, with the usual lighting or your own.
            background: (red, green, blue) 0..1; None leaves the picture transparent.
            step_voxels: distance between samples in voxels (smallest spacing) of the level shown.
            level: of the pyramid; None takes the finest that is useful and fits the budget.
            t: time step.
            c: channel.

        Raises:
            InvalidInputError: an argument is out of its range.
            UnsupportedError: voxels of a type that cannot be rendered.
            PictureTooLargeError: not even a thin slab of the view fits the budget.
            CorruptBrickError: a brick is damaged.
        """
        started = time.perf_counter()
        request = _Request(
            drawable(volume),
            camera,
            transfer_function,
            checked_size(size, self._context.picture_side_max),
            checked_window(window, volume.window),
            shading if isinstance(shading, Lighting) else Lighting() if shading else None,
            checked_background(background),
            _checked_step(step_voxels),
            checked_level(volume, level),
            _checked_index("t", t, volume.nt),
            _checked_index("c", c, volume.nc),
        )
        with self._context.current() as gl:
            return self._render(gl, request, started)

    def _render(self, gl: moderngl.Context, request: _Request, started: float) -> RenderedImage:
        clock = PassClock(gl, software=self._context.software)
        with clock.measure("select", on_gpu=False):
            wanted = finest_useful_level(request.volume, request.camera, request.size)
            plan = self._choose(request, wanted)
        uploaded_before = self._filler.uploaded_nbytes
        filled, nslabs = Filled(), 0
        width, height = request.size
        premultiplied = np.zeros((height, width, 4), np.float32)
        if plan.slabs is not None:
            nslabs = self._cast_slabs(request, plan, plan.slabs, clock, filled)
            premultiplied = self._raycaster.picture()
        voxel_nbytes = SlabFormat.of(request.volume.dtype).voxel_nbytes
        stats = RenderStats(
            level=plan.level,
            bricks=plan.selection.counts | {"decoded": filled.nbricks, "absent": filled.nabsent},
            slabs=nslabs,
            slabs_planned=len(plan.slabs.slabs) if plan.slabs else 0,
            uploaded_nbytes=self._filler.uploaded_nbytes - uploaded_before,
            resident_nbytes=self._filler.resident_nbytes,
            decoded_nbytes=filled.nvoxels * voxel_nbytes,
            slab_nbytes=self._slab.nbytes,
            step_world=plan.step_world,
            reference_length_world=plan.reference_length_world,
            window=request.window,
            milliseconds=clock.milliseconds() | {"total": 1e3 * (time.perf_counter() - started)},
            gl_renderer=self._context.renderer_name,
        )
        rgba = finish(premultiplied, request.background)
        return RenderedImage(rgba, premultiplied, _fidelity(request, plan, wanted), stats)

    def _choose(self, request: _Request, wanted: int) -> _Plan:
        """The plan at the level asked for, or at the finest from `wanted` on that fits."""
        nlevels = len(request.volume.levels)
        first = wanted if request.level is None else request.level
        levels = range(first, nlevels) if request.level is None else [first]
        too_large = None
        for level in levels:
            try:
                plan = self._plan(request, level)
            except PictureTooLargeError as error:
                too_large = error
                continue
            # Coarser, so that the working set stays resident; but the coarsest is shown anyhow.
            code_nbytes = CodeLayout.of(request.volume, level).code_nbytes
            fits = int(plan.selection.needed.sum()) * code_nbytes <= self._brick_nbytes
            if fits or request.level is not None or level == nlevels - 1:
                return plan
        assert too_large is not None
        raise too_large

    def _plan(self, request: _Request, level: int) -> _Plan:
        volume, geometry = request.volume, request.volume.levels[level]
        finest = volume.levels[0]
        step_world = request.step_voxels * min(geometry.spacing_xyz)
        reference = request.function.reference_length_world(finest.spacing_xyz, finest.shape_zyx)
        scale = ValueScale.of(volume.dtype, volume.value_range)
        classifier = Classifier(request.function, scale, request.window, step_world / reference)
        view = make_view(request.camera, request.size, geometry)
        selection = select_bricks(
            volume, level, view, classifier, t=request.t, c=request.c, cull=self._cull
        )
        slabs = None
        if selection.box.nvoxels > 0:
            slabs = self._plan_slabs(request, level, view, selection)
        return _Plan(level, view, classifier, selection, slabs, step_world, reference)

    def _plan_slabs(
        self, request: _Request, level: int, view: View, selection: Selection
    ) -> SlabPlan:
        geometry = request.volume.levels[level]
        axis_xyz = view.main_axis
        if request.camera.fov_degrees is None:
            eye = -math.copysign(math.inf, view.forward_world[axis_xyz])
        else:
            eye = float(
                (view.eye_world[axis_xyz] - geometry.origin_xyz[axis_xyz])
                / geometry.spacing_xyz[axis_xyz]
                + 0.5
            )
        plan = plan_slabs(
            selection.box,
            geometry.shape_zyx,
            request.volume.brick_shape_zyx,
            2 - axis_xyz,
            eye,
            nvoxels_max=self._slab_nbytes // SlabFormat.of(request.volume.dtype).voxel_nbytes,
            side_max=self._context.volume_side_max,
        )
        if plan is None:
            raise PictureTooLargeError(
                f"level {level} of this view is {selection.box.shape_zyx} voxels (z, y, x), of "
                f"which not even a thin slab fits {self._slab_nbytes} bytes and "
                f"{self._context.volume_side_max} voxels a side; raise memory_budget, show a "
                "coarser level, or move closer",
                level=level,
                box_zyx=list(selection.box.shape_zyx),
                slab_nbytes=self._slab_nbytes,
            )
        return plan

    def _cast_slabs(
        self,
        request: _Request,
        plan: _Plan,
        slabs: SlabPlan,
        clock: PassClock,
        filled: Filled,
    ) -> int:
        """Run the passes; how many slabs were cast. What filling them took is added to `filled`."""
        geometry = request.volume.levels[plan.level]
        self._raycaster.begin(
            Frame(
                plan.view,
                geometry.shape_zyx,
                geometry.spacing_xyz,
                plan.step_world,
                plan.selection.box,
                plan.classifier,
                request.lighting,
            )
        )
        ndone = 0
        for slab in slabs.slabs:
            bricks_box = bricks_of(slab.content, request.volume.brick_shape_zyx)
            if not plan.selection.sampled[bricks_box.slices].any():
                continue
            with clock.measure("decode"):
                filled.add(self._fill(request, plan, slabs, slab))
            grid = CellGrid.of(request.volume.brick_shape_zyx, slab.content)
            with clock.measure("empty space"):
                emptiness = self._empty_space.find(
                    self._slab,
                    request.volume.brick_shape_zyx,
                    grid,
                    plan.selection.sampled,
                    plan.classifier,
                    skip=self._cull,
                )
            with clock.measure("cast"):
                self._raycaster.cast(slab, slabs.axis_zyx, self._slab, grid, emptiness)
            ndone += 1
            if slab is not slabs.slabs[-1] and not self._raycaster.rays_unfinished():
                break
        return ndone

    def _fill(self, request: _Request, plan: _Plan, slabs: SlabPlan, slab: Slab) -> Filled:
        """Decode a slab."""
        volume = request.volume
        bricks_box = bricks_of(slab.content, volume.brick_shape_zyx)
        found = np.argwhere(plan.selection.needed[bricks_box.slices]) + bricks_box.start_zyx
        needed: list[Zyx] = [(z, y, x) for z, y, x in found.tolist()]
        content = SlabContent(volume.revision, plan.level, request.t, request.c, slab.content)
        self._slab.require(SlabFormat.of(volume.dtype), slabs.buffer_zyx)
        return self._filler.fill(volume, self._slab, content, needed)


def _fidelity(request: _Request, plan: _Plan, wanted: int) -> Fidelity:
    errors = np.asarray(request.volume.fidelity(plan.level, request.t, request.c))[..., 0]
    sampled = errors[plan.selection.sampled]
    return Fidelity(
        level=plan.level,
        finest_level_wanted=wanted,
        max_error=float(sampled.max()) if sampled.size else 0.0,
        converged=plan.level <= wanted,
    )


def _checked_step(step_voxels: float) -> float:
    if not STEP_VOXELS_MIN <= step_voxels <= STEP_VOXELS_MAX:
        raise InvalidInputError(
            f"step_voxels {step_voxels} must be between {STEP_VOXELS_MIN} and {STEP_VOXELS_MAX}",
            option="step_voxels",
        )
    return float(step_voxels)


def _checked_index(name: str, index: int, count: int) -> int:
    if not (isinstance(index, (int, np.integer)) and 0 <= index < count):
        raise InvalidInputError(f"{name} {index!r}: there are 0 to {count - 1}", option=name)
    return int(index)
