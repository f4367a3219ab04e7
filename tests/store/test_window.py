"""Windows of planes: in memory, in pieces as they came, and in scratch files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octobrick.store.window import (
    MemoryWindow,
    PieceWindow,
    ScratchWindow,
    Window,
    WindowShape,
    memory_window,
)

MakeWindow = Callable[[int, tuple[int, ...], str], Window]


class WindowContract:
    """What every window keeps."""

    @pytest.fixture
    def make(self, tmp_path: Path) -> MakeWindow:
        raise NotImplementedError

    @pytest.mark.parametrize(("tail", "dtype"), [((), "uint16"), ((3,), "uint8")])
    def test_rows_are_what_was_put_in_any_order_while_planes_come_and_go(
        self, make: MakeWindow, tail: tuple[int, ...], dtype: str
    ) -> None:
        rng = np.random.default_rng(3)
        level = rng.integers(0, 250, (40, 12, 9, *tail)).astype(dtype)
        window = make(14, (12, 9, *tail), dtype)
        for z in range(0, 40, 4):
            for y in (8, 0, 4):
                window.put(z, y, level[z : z + 4, y : y + 4].copy())
            window.complete_to(z + 4)
            first = max(window.first_z, z - 5)
            columns = window.rows(first, z + 4, 3, 10)
            np.testing.assert_array_equal(columns(2, 7), level[first : z + 4, 3:10, 2:7])
            np.testing.assert_array_equal(columns(0, 9), level[first : z + 4, 3:10])
            window.drop_to(max(window.first_z, z - 6))
        np.testing.assert_array_equal(np.concatenate(list(window.held())), level[30:])
        assert window.held_shape == (10, 12, 9, *tail)

    def test_what_is_held_comes_in_pieces_that_follow_each_other(
        self, make: MakeWindow, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        level = np.arange(5 * 12 * 9, dtype=np.uint16).reshape(5, 12, 9)
        window = make(5, (12, 9), "uint16")
        window.put(0, 0, level)
        window.complete_to(5)
        for piece_nbytes in (1, 5 * 9 * 2, 12 * 9 * 2, 3 * 12 * 9 * 2, 2**20):
            monkeypatch.setattr("octobrick.store.window._PIECE_NBYTES", piece_nbytes)
            pieces = list(window.held())
            assert max(piece.nbytes for piece in pieces) <= max(piece_nbytes, 9 * 2)
            np.testing.assert_array_equal(
                np.concatenate([p.ravel() for p in pieces]), level.ravel()
            )

    def test_blocks_beside_each_other_are_rows(self, make: MakeWindow) -> None:
        level = np.arange(2 * 4 * 9, dtype=np.uint16).reshape(2, 4, 9)
        window = make(4, (4, 9), "uint16")
        window.put_blocks(0, 0, [level[:, :, :4], level[:, :, 4:8], level[:, :, 8:]])
        window.complete_to(2)
        np.testing.assert_array_equal(window.rows(0, 2, 0, 4)(0, 9), level)

    def test_one_that_begins_elsewhere_is_empty(self, make: MakeWindow) -> None:
        window = make(6, (2, 3), "uint16")
        window.begin_at(100)
        assert not list(window.held())
        plane = np.full((1, 2, 3), 7, np.uint16)
        window.put(100, 0, plane)
        window.complete_to(101)
        np.testing.assert_array_equal(window.rows(100, 101, 0, 2)(0, 3), plane)


class TestMemoryWindow(WindowContract):
    @pytest.fixture
    def make(self) -> MakeWindow:
        return lambda n, shape, dtype: MemoryWindow(n, shape, np.dtype(dtype))


class TestPieceWindow(WindowContract):
    @pytest.fixture
    def make(self) -> MakeWindow:
        return lambda n, shape, dtype: PieceWindow(n, shape, np.dtype(dtype))

    def test_what_was_put_is_not_copied_and_let_go(self) -> None:
        window = PieceWindow(8, (2, 3), np.dtype(np.uint8))
        pieces = [np.full((2, 2, 3), i, np.uint8) for i in range(3)]
        for i, piece in enumerate(pieces):
            window.put(2 * i, 0, piece)
        window.complete_to(6)
        window.drop_to(3)
        pieces[1][...] = 9  # still the piece itself
        assert (window.rows(3, 4, 0, 2)(0, 3) == 9).all()
        window.drop_to(4)
        assert [held.shape for held in window.held()] == [(2, 2, 3)]


class TestScratchWindow(WindowContract):
    @pytest.fixture
    def make(self, tmp_path: Path) -> MakeWindow:
        return lambda n, shape, dtype: ScratchWindow(n, shape, np.dtype(dtype), tmp_path)

    def test_its_file_has_no_name(self, make: MakeWindow, tmp_path: Path) -> None:
        window: Any = make(4, (4, 9), "uint16")
        window.put(0, 0, np.ones((2, 4, 9), np.uint16))
        assert not list(tmp_path.iterdir())


def test_level_0_keeps_the_pieces_of_the_source_and_others_take_blocks() -> None:
    shape = WindowShape(4, (4, 9), np.dtype(np.uint8))
    assert isinstance(memory_window("0", shape), PieceWindow)
    assert isinstance(memory_window("1", shape), MemoryWindow)
    assert isinstance(memory_window("gradient/1", shape), MemoryWindow)
