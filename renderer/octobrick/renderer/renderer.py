"""Renders pictures of volumes that are larger than memory: the order of a frame's passes.

For every slab, front to back: make its bricks resident, decode them into the slab buffers, find the
empty space, cast the rays through it. docs/rendering.md tells the whole.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, Self, get_args

from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.renderer.brick_loader import BrickLoader, LoadStats
from octobrick.renderer.brick_ranges import brick_errors
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.budget import split_budget
from octobrick.renderer.camera import Camera
from octobrick.renderer.clip import Clip
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.decoded_bricks import drawable
from octobrick.renderer.frame_passes import Drawn, FramePasses
from octobrick.renderer.frame_plan import FramePlan, Limits, plan_frame
from octobrick.renderer.gpu_filler import GpuFiller
from octobrick.renderer.host_filler import HostFiller
from octobrick.renderer.image import Fidelity, RenderedImage, RenderStats
from octobrick.renderer.lighting import Lighting
from octobrick.renderer.modes import Mode
from octobrick.renderer.pass_clock import PassClock
from octobrick.renderer.render_request import RenderRequest, make_request
from octobrick.renderer.selection import finest_useful_level
from octobrick.renderer.slab_filler import SlabFiller
from octobrick.renderer.solid_texture.mesh_pictures import MeshPictures
from octobrick.renderer.solid_texture.mesh_request import make_mesh_request
from octobrick.renderer.streaming import continued, wanted_bricks
from octobrick.renderer.transfer_function import TransferFunction
from octobrick.store.surface import Mesh, Placement
from octobrick.store.surface.placement import UpAxis

if TYPE_CHECKING:
    import moderngl

DecodeOn = Literal["auto", "gpu", "cpu"]


class Renderer:
    """A renderer with its own OpenGL context. Call it from any thread; calls take turns.

    Bricks stay on the GPU, compressed, between pictures. Close it, or use it in a with statement.

    Args:
        memory_budget: GPU memory for bricks and the slab buffer, as bytes or text ("512MiB").
        slab_budget: the slab buffer's part of it; by default a quarter.
        decode: where bricks are held and decoded: on the "gpu", on the "cpu", which is many times
            faster where the driver renders on the CPU too, or "auto" by what the driver is.
        threads: that read bricks.
        cull: False samples every brick and every step. For tests and measurements.

    Raises:
        GraphicsContextError: no OpenGL 4.5 through EGL; the message says what to install.
    """

    def __init__(
        self,
        memory_budget: int | str = "512MiB",
        *,
        slab_budget: int | str | None = None,
        decode: DecodeOn = "auto",
        threads: int = 4,
        cull: bool = True,
    ) -> None:
        brick_nbytes, slab_nbytes = split_budget(memory_budget, slab_budget)
        if decode not in get_args(DecodeOn):
            raise InvalidInputError(
                f"decode {decode!r}: choose one of {list(get_args(DecodeOn))}", option="decode"
            )
        self._cull = cull
        self._last_camera: Camera | None = None
        self._meshes: MeshPictures | None = None
        with ExitStack() as undo:
            self._context = GraphicsContext()
            undo.callback(self._context.release)
            self._limits = Limits(brick_nbytes, slab_nbytes, self._context.volume_side_max)
            self._loader = BrickLoader(threads)
            undo.callback(self._loader.close)
            on_cpu = self._context.software if decode == "auto" else decode == "cpu"
            self.decodes_on: DecodeOn = "cpu" if on_cpu else "gpu"
            """Where bricks are held and decoded: "gpu" or "cpu"."""
            make_filler = HostFiller if on_cpu else GpuFiller
            with self._context.current() as gl:
                self._filler: SlabFiller = make_filler(
                    self._context, gl, brick_nbytes, self._loader
                )
                self._passes = FramePasses(self._context, gl, self._filler, self._limits, cull=cull)
            undo.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the context and all memory, and end all threads. Idempotent."""
        self._loader.close()
        with suppress(InvalidInputError), self._context.current():  # closed already
            self._filler.forget()
            self._forget_meshes()
        self._context.release()

    def forget_bricks(self) -> None:
        """Free the GPU memory of all bricks and of the slab; the next picture loads its own."""
        with self._context.current():
            self._filler.forget()
            self._passes.release()
            self._forget_meshes()

    def _forget_meshes(self) -> None:
        if self._meshes is not None:
            self._meshes.release()
            self._meshes = None

    @property
    def gl_renderer(self) -> str:
        """The driver's name of the device."""
        return self._context.renderer_name

    def render(
        self,
        volume: BrickSource,
        camera: Camera,
        transfer_function: TransferFunction | Sequence[TransferFunction],
        size: tuple[int, int] = (768, 768),
        *,
        mode: Mode | str = "dvr",
        window: tuple[float, float] | Sequence[tuple[float, float]] | None = None,
        shading: bool | Lighting = True,
        gradients: str = "auto",
        edges: tuple[float, float] | None = None,
        deblocking: bool | float = False,
        clip: Clip | None = None,
        background: Sequence[float] | None = (0.0, 0.0, 0.0),
        step_voxels: float = 0.5,
        level: int | None = None,
        t: int = 0,
        c: int | Sequence[int] = 0,
        rgb: bool = False,
        depth: bool = False,
        direct: str | None = None,
        wait: bool = True,
    ) -> RenderedImage:
        """A picture of a volume.

        Args:
            volume: an `octobrick.store.Volume`, or anything that fits `BrickSource`.
            camera: where from.
            transfer_function: which colour and opacity a value has; one for all channels, or one
                for each.
            size: (width, height) in pixels.
            mode: what rays make of their samples: "dvr", "mip", "minip", "average", or an
                `Isosurface` or a `Slice`.
            window: values at relative positions 0 and 1; None takes the volume's. One for each
                channel, or one for all.
            shading: light surfaces by their gradient, with the usual lighting or your own. Not
                for projections and slices.
            gradients: "stored" takes the volume's gradient pyramid at levels that have it, and
                "differences" central differences of what is shown; "auto" the first where it is.
            edges: (low, high): opacity grows from 0 to its full value between these magnitudes of
                the gradient, in widths of the window per voxel of level 0.
            deblocking: smooth what the codec's blocks left, with the usual strength or your own.
            clip: which part of space is shown; None shows all.
            background: (red, green, blue) 0..1; None leaves the picture transparent.
            step_voxels: distance between samples in voxels (smallest spacing) of the level shown.
            level: of the pyramid; None takes the finest that is useful and fits the budget.
            t: time step.
            c: channel, or up to four.
            rgb: the three channels of c are red, green and blue; their luminance has the opacity
                that the (first) transfer function gives it.
            depth: tell how far away is what is seen.
            direct: decode what rays touch instead of slabs, from S3Dc at a fixed rate: "nearest"
                voxels, "linear" (eight of them for each sample), or "shared" (what these have in
                common is fetched once). Needs all bricks of the view at once on the device; slower,
                for comparison and where there is no room for a slab.
            wait: for all bricks. If not, coarser ones stand for those that have not been read yet,
                ``stats.bricks["substituted"]`` tells of how many, and reading goes on behind: what
                this view wants, then what a camera that moves on will want.

        Raises:
            InvalidInputError: an argument is out of its range, or two do not go together.
            UnsupportedError: voxels of a type that cannot be rendered.
            PictureTooLargeError: not even a thin slab of the view fits the budget.
            CorruptBrickError: a brick is damaged.
        """
        started = time.perf_counter()
        request = make_request(
            drawable(volume),
            camera,
            transfer_function,
            size,
            mode=mode,
            window=window,
            shading=shading,
            gradients=gradients,
            edges=edges,
            deblocking=deblocking,
            clip=clip,
            background=background,
            step_voxels=step_voxels,
            level=level,
            t=t,
            c=c,
            rgb=rgb,
            depth=depth,
            direct=direct,
            size_max=self._context.picture_side_max,
        )
        with self._context.current() as gl:
            self._forget_meshes()
            self._filler.waits = wait
            if not wait:
                self._loader.want(())  # what an earlier view wanted
            image = self._render(gl, request, started)
            if not wait:
                self._prefetch_motion(request)
            self._last_camera = camera
        return image

    def render_mesh(
        self,
        volume: BrickSource,
        mesh: Mesh,
        camera: Camera,
        size: tuple[int, int] = (768, 768),
        *,
        placement: Placement | None = None,
        up: UpAxis = "z",
        sampling: str = "linear",
        transfer_function: TransferFunction | None = None,
        window: tuple[float, float] | Sequence[tuple[float, float]] | None = None,
        shading: bool | Lighting = True,
        background: Sequence[float] | None = (0.0, 0.0, 0.0),
        level: int | None = None,
        t: int = 0,
        c: int | Sequence[int] | None = None,
    ) -> RenderedImage:
        """A picture of a mesh that has a volume as its solid texture.

        Only tiles of the texture that the mesh touches are read and kept on the GPU, decoded.
        What lies outside of the volume is grey.

        Args:
            volume: the texture.
            mesh: what `octobrick.store.read_mesh` gives.
            camera: where from.
            size: (width, height) in pixels.
            placement: where the mesh lies in the volume; None takes the one that the volume was
                made for, or fits it in.
            up: which of the mesh's axes is then the world's z.
            sampling: "linear" between the eight texels around a place, or the "nearest" one.
            transfer_function: colours of a single channel's values; else channels are red, green
                and blue.
            window: values of no and of full colour; None takes all that a byte has, of other types
                the volume's window.
            shading: light the surface, with the usual lighting or your own.
            background: (red, green, blue) 0..1; None leaves the picture transparent.
            level: of the pyramid; None takes the finest that has a texel for every pixel and fits
                the budget.
            t: time step.
            c: three channels, or one with a transfer function.

        Raises:
            InvalidInputError: an argument is out of its range, or two do not go together.
            PictureTooLargeError: what the surface touches does not fit the budget.
            CorruptBrickError: a brick is damaged.
        """
        started = time.perf_counter()
        request = make_mesh_request(
            drawable(volume),
            mesh,
            camera,
            size,
            placement=placement,
            up=up,
            sampling=sampling,
            transfer_function=transfer_function,
            window=window,
            shading=shading,
            background=background,
            level=level,
            t=t,
            c=c,
            size_max=self._context.picture_side_max,
        )
        with self._context.current() as gl:
            if self._meshes is None:
                self._filler.forget()  # the budget is for one of both
                self._passes.release()
                self._meshes = MeshPictures(self._context, gl, self._limits.brick_nbytes)
            return self._meshes.render(request, started)

    def prefetch(
        self,
        volume: BrickSource,
        camera: Camera,
        transfer_function: TransferFunction | Sequence[TransferFunction],
        size: tuple[int, int] = (768, 768),
        **scene: Any,
    ) -> None:
        """Read bricks that a later call of `render` with these arguments needs, in the background.

        They are read when nothing is left that a picture waits for, up to a bounded memory.
        """
        request = make_request(drawable(volume), camera, transfer_function, size, **scene)
        with self._context.current():
            self._prefetch(request)

    def wait_for_arrivals(self, timeout_seconds: float) -> None:
        """Return when a brick was read, when none is left to read, or when time is over."""
        self._loader.wait_for_arrivals(timeout_seconds)

    @property
    def load_stats(self) -> LoadStats:
        """What reading bricks took since the renderer was made."""
        return self._loader.stats

    def _prefetch(self, request: RenderRequest) -> None:
        plan = plan_frame(request, self._limits)
        wanted = wanted_bricks(request, plan)
        self._loader.prefetch(brick for brick in wanted if not self._filler.holds(brick.address))

    def _prefetch_motion(self, request: RenderRequest) -> None:
        """What the camera will see if it goes on as it moved since the last picture."""
        if self._last_camera is None:
            return
        ahead = continued(self._last_camera, request.camera)
        if ahead is not None:
            with suppress(OctobrickError):  # where it leads may be nowhere
                self._prefetch(replace(request, camera=ahead))

    def _render(
        self, gl: moderngl.Context, request: RenderRequest, started: float
    ) -> RenderedImage:
        clock = PassClock(gl, software=self._context.software)
        with clock.measure("select", on_gpu=False):
            plan = plan_frame(request, self._limits, cull=self._cull)
        uploaded_before = self._uploaded_nbytes
        drawn = self._passes.draw(request, plan, clock)
        canvas = self._passes.canvas
        with clock.measure("finish"):
            rgba = canvas.finished(request.background)
        premultiplied = canvas.picture()
        depth = canvas.depth() if request.depth else None
        stats = RenderStats(
            level=plan.level,
            bricks=drawn.counts(plan),
            slabs=drawn.nslabs,
            slabs_planned=len(plan.slabs.slabs) if plan.slabs else 0,
            uploaded_nbytes=self._uploaded_nbytes - uploaded_before,
            resident_nbytes=self._filler.resident_nbytes + self._passes.direct_nbytes,
            decoded_nbytes=drawn.filled.nvoxels * plan.layout.decoded.voxel_nbytes,
            slab_nbytes=self._passes.slab_nbytes,
            step_world=plan.step_world,
            reference_length_world=plan.reference_length_world,
            window=request.channels[0].window,
            milliseconds=clock.milliseconds() | {"total": 1e3 * (time.perf_counter() - started)},
            gl_renderer=self._context.renderer_name,
        )
        fidelity = _fidelity(request, plan, drawn)
        return RenderedImage(rgba, premultiplied, fidelity, stats, depth)

    @property
    def _uploaded_nbytes(self) -> int:
        return self._filler.uploaded_nbytes + self._passes.direct_uploaded_nbytes


def _fidelity(request: RenderRequest, plan: FramePlan, drawn: Drawn) -> Fidelity:
    errors = [
        brick_errors(request.volume, plan.level, request.t, channel.c)[drawn.sampled]
        for channel in request.channels
    ]
    wanted = finest_useful_level(request.volume, request.camera, request.size)
    return Fidelity(
        level=plan.level,
        finest_level_wanted=wanted,
        max_error=max((float(e.max()) for e in errors if e.size), default=0.0),
        converged=plan.level <= wanted and not drawn.filled.nsubstituted,
        coarsest_level=plan.level + drawn.filled.nlevels_up if drawn.filled.nlevels_up else None,
    )
