"""The implementations under test, by the name that `table.holds` gives as `implementation`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from octobrick.renderer import Renderer
from octobrick.renderer.context import GraphicsContext

from .ways_to_code import S3dcWay, ZerobitWay, s3dc_way, zerobit_way
from .ways_to_filter import DeblockingWay, GradientWay, deblocking_way, gradient_way


@pytest.fixture
def implementation() -> str:
    """`table.holds` stands in for this one."""
    raise AssertionError("a test of an extreme needs table.holds")


@pytest.fixture(scope="session")
def graphics() -> Iterator[GraphicsContext]:
    """A context that compiles each program once for all tests."""
    context = GraphicsContext()
    yield context
    context.release()


@pytest.fixture(scope="session")
def renderer() -> Iterator[Renderer]:
    with Renderer("256MiB") as shared:
        yield shared


@pytest.fixture
def way_arguments(implementation: str, request: pytest.FixtureRequest) -> tuple[Any, Any]:
    """Context and renderer of the implementations that need them."""
    return (
        request.getfixturevalue("graphics") if implementation == "glsl" else None,
        request.getfixturevalue("renderer") if implementation == "direct" else None,
    )


@pytest.fixture
def s3dc(implementation: str, way_arguments: tuple[Any, Any]) -> S3dcWay:
    return s3dc_way(implementation, *way_arguments)


@pytest.fixture
def zerobit(implementation: str, way_arguments: tuple[Any, Any]) -> ZerobitWay:
    return zerobit_way(implementation, way_arguments[0])


@pytest.fixture
def deblocking(implementation: str, way_arguments: tuple[Any, Any]) -> DeblockingWay:
    return deblocking_way(implementation, way_arguments[0])


@pytest.fixture
def directions(implementation: str, way_arguments: tuple[Any, Any]) -> GradientWay:
    return gradient_way(implementation, way_arguments[0])


@pytest.fixture
def noise() -> Any:
    """A maker of arrays that use the whole range of their type (float32: about ±100)."""

    def make(shape: tuple[int, ...], dtype: Any, seed: int = 1) -> Any:
        rng, dtype = np.random.default_rng(seed), np.dtype(dtype)
        if dtype.kind == "f":
            return (rng.normal(size=shape) * 30).astype(dtype)
        info = np.iinfo(dtype)
        array = rng.integers(info.min, info.max, shape, dtype, endpoint=True)
        array.flat[0], array.flat[-1] = info.min, info.max
        return array

    return make
