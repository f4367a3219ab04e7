"""The context: where it may be used, and what it says where there is none."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Camera, Renderer, ShaderError, TransferFunction
from octobrick.renderer import renderer as renderer_module
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.uniforms import set_uniforms

from .array_source import ArraySource

pytestmark = pytest.mark.gl

FUNCTION = TransferFunction(((0.0, (1.0, 1.0, 1.0)),), ((0.0, 0.1),))


def source() -> ArraySource:
    return ArraySource(np.full((20, 20, 20), 7, np.uint8), brick=16)


def test_a_renderer_may_be_called_from_many_threads(renderer: Renderer) -> None:
    volume = source()

    def picture(azimuth: float) -> np.ndarray:
        camera = Camera.orbit(volume, azimuth, 20)
        return renderer.render(volume, camera, FUNCTION, (20, 20)).rgba

    wanted = [picture(a) for a in (0, 30, 60)]
    with ThreadPoolExecutor(3) as threads:
        found = list(threads.map(picture, [0, 30, 60] * 4))
    for i, rgba in enumerate(found):
        np.testing.assert_array_equal(rgba, wanted[i % 3])


def test_two_renderers_in_turn_do_not_disturb_each_other() -> None:
    volume = source()
    camera = Camera.orbit(volume, 30, 20)
    with Renderer() as one, Renderer() as other:
        pictures = [r.render(volume, camera, FUNCTION, (20, 20)).rgba for r in (one, other, one)]
    np.testing.assert_array_equal(pictures[0], pictures[1])
    np.testing.assert_array_equal(pictures[0], pictures[2])


def test_a_closed_renderer_says_so_and_closes_again() -> None:
    renderer = Renderer()
    renderer.close()
    renderer.close()
    with pytest.raises(InvalidInputError, match="closed"):
        renderer.render(source(), Camera.orbit(source()), FUNCTION, (8, 8))


@pytest.mark.parametrize("part", ["HostFiller", "FramePasses"])
def test_a_renderer_that_cannot_be_made_leaves_no_context_and_no_thread(
    monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    released = []
    release = GraphicsContext.release

    def fail(*_: object, **__: object) -> None:
        raise ShaderError("no such shader")

    def counted(context: GraphicsContext) -> None:
        release(context)
        released.append(context)

    monkeypatch.setattr(renderer_module, part, fail)
    monkeypatch.setattr(GraphicsContext, "release", counted)
    before = threading.active_count()
    with pytest.raises(ShaderError, match="no such shader"):
        Renderer(decode="cpu")
    assert len(released) == 1
    with pytest.raises(InvalidInputError, match="closed"), released[0].current():
        pass
    assert threading.active_count() == before


def test_forgetting_frees_everything_and_the_next_picture_is_the_same(renderer: Renderer) -> None:
    volume = source()
    pictures = []
    for _ in range(2):
        pictures.append(renderer.render(volume, Camera.orbit(volume), FUNCTION, (8, 8)))
        renderer.forget_bricks()
    assert pictures[1].stats.uploaded_nbytes == pictures[0].stats.uploaded_nbytes > 0
    np.testing.assert_array_equal(pictures[0].rgba, pictures[1].rgba)


@pytest.mark.parametrize(
    "arguments",
    [
        {"step_voxels": 0.0},
        {"step_voxels": float("nan")},
        {"step_voxels": 17.0},
        {"level": 9},
        {"t": 1},
        {"c": -1},
        {"window": (3, 3)},
        {"background": (0, 0)},
        {"size": (0, 8)},
        {"size": (1 << 20, 8)},
    ],
)
def test_impossible_arguments_are_refused(renderer: Renderer, arguments: dict) -> None:
    with pytest.raises(InvalidInputError):
        renderer.render(source(), Camera.orbit(source()), FUNCTION, **arguments)


@pytest.mark.parametrize(
    "budgets", [("0", None), ("1MiB", "1MiB"), ("1MiB", "2MiB"), ("many", None)]
)
def test_impossible_budgets_are_refused(budgets: tuple[str, str | None]) -> None:
    with pytest.raises(InvalidInputError):
        Renderer(budgets[0], slab_budget=budgets[1])


def test_without_a_driver_the_error_says_what_to_install() -> None:
    """In a process of its own, whose EGL finds no vendor."""
    code = "import octobrick.renderer as r; r.Renderer()"
    environment = os.environ | {"__EGL_VENDOR_LIBRARY_FILENAMES": os.devnull}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True
    )
    assert done.returncode != 0
    last = done.stderr.strip().splitlines()[-1]
    assert "GraphicsContextError" in last
    assert "install libegl1, libgl1 and libgl1-mesa-dri" in last


def test_a_shader_that_does_not_compile_shows_the_compilers_words() -> None:
    context = GraphicsContext()
    with context.current(), pytest.raises(ShaderError, match=r"(?s)nonsense.*\d+  .*nonsense"):
        context.program("distance.comp.glsl", REACH="nonsense")
    context.release()


def test_a_uniform_that_the_program_lacks_is_refused() -> None:
    context = GraphicsContext()
    with context.current():
        program = context.program("distance.comp.glsl", REACH=3)
        assert context.program("distance.comp.glsl", REACH=3) is program
        with pytest.raises(ShaderError, match="no uniform reach"):
            set_uniforms(program, {"reach": 3})
    context.release()
