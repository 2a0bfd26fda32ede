"""Borders: as many as there are, the right cells in the right order, on any grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy.ndimage import label

from mapping.artifacts import Thresholded
from mapping.borders import (
    TracedBorder,
    find_borders,
    threshold_layer,
    trace_borders,
    walk_border,
)
from mapping.config import BordersSection
from mapping.grid import GridGeometry, Layer
from tests.border_grids import CLASSES, FIGURES, drawn
from tests.naive_borders import naive_borders, started_at_least

EIGHT = np.ones((3, 3), int)


def sequences(borders: list[TracedBorder]) -> list[tuple[bool, tuple[tuple[int, int], ...]]]:
    """Each border with its cells from a start that does not depend on the tracer, sorted."""
    return sorted(
        (b.outer, started_at_least([(int(r), int(c)) for r, c in b.cells])) for b in borders
    )


def components_and_holes(occupied: NDArray[np.bool_]) -> tuple[int, int]:
    """How many figures (eight neighbours) and how many holes (four) a grid has."""
    figures = label(occupied, EIGHT)[1]
    return figures, label(~np.pad(occupied, 1))[1] - 1


def signed_area(cells: NDArray[np.int64]) -> float:
    """Of the polygon through the cells' centres: above 0 when it runs counter-clockwise."""
    y, x = cells.T.astype(float)
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2.0


@pytest.mark.parametrize("name", FIGURES)
def test_known_figures(name: str) -> None:
    picture, wanted = FIGURES[name]
    borders = trace_borders(drawn(picture))
    found = [(b.outer, len(set(map(tuple, b.cells.tolist()))), len(b.cells)) for b in borders]
    assert sorted(found) == sorted(wanted)
    assert len(borders) == sum(components_and_holes(drawn(picture)))


@pytest.mark.parametrize("name", CLASSES)
def test_equal_to_opencv_on_a_thousand_grids(name: str) -> None:
    import cv2  # a test dependency: without it this fails, it is not skipped

    rng = np.random.default_rng([7, sorted(CLASSES).index(name)])
    borders_seen = 0
    for _ in range(1000):
        grid = CLASSES[name](rng)
        # OpenCV's first row is the highest on the screen.
        screen = np.ascontiguousarray(grid[::-1]).astype(np.uint8)
        contours, tree = cv2.findContours(screen, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        theirs = [
            (
                bool(tree[0, k, 3] < 0),
                started_at_least([(grid.shape[0] - 1 - int(y), int(x)) for x, y in c[:, 0]]),
            )
            for k, c in enumerate(contours)
        ]
        ours = sequences(trace_borders(grid))
        assert ours == sorted(theirs), f"\n{grid.astype(int)}"
        assert len(ours) == sum(components_and_holes(grid))
        borders_seen += len(ours)
    assert borders_seen > 2000


@pytest.mark.parametrize("name", CLASSES)
def test_equal_to_the_walk_along_cracks(name: str) -> None:
    rng = np.random.default_rng([8, sorted(CLASSES).index(name)])
    for _ in range(60):
        grid = CLASSES[name](rng)
        theirs = sorted(started_at_least(cells) for cells in naive_borders(grid))
        assert sorted(cells for _, cells in sequences(trace_borders(grid))) == theirs


@settings(deadline=None, max_examples=150)
@given(hnp.arrays(np.bool_, st.tuples(st.integers(0, 9), st.integers(0, 20))))
def test_laws_of_a_border(occupied: NDArray[np.bool_]) -> None:
    borders = trace_borders(occupied)
    figures, holes = components_and_holes(occupied)
    assert sum(b.outer for b in borders) == figures
    assert sum(not b.outer for b in borders) == holes
    white = ~np.pad(occupied, 1)
    beside_white = white[2:, 1:-1] | white[:-2, 1:-1] | white[1:-1, 2:] | white[1:-1, :-2]
    on_a_border = np.zeros_like(occupied)
    for border in borders:
        r, c = border.cells.T
        on_a_border[r, c] = True
        steps = np.abs(np.roll(border.cells, -1, axis=0) - border.cells).max(axis=1)
        assert len(border.cells) == 1 or set(steps) == {1}, "a closed chain of neighbours"
        area = signed_area(border.cells)
        assert area >= 0 if border.outer else area < 0
    np.testing.assert_array_equal(on_a_border, occupied & beside_white)


def test_borders_start_where_a_scan_from_the_top_left_meets_them() -> None:
    grid = drawn("......#/.##..../.##..../......#")
    assert [tuple(b.cells[0]) for b in trace_borders(grid)] == [(3, 6), (2, 1), (0, 6)]
    # Counter-clockwise with y up: from the top left down the west side first.
    assert trace_borders(grid)[1].cells.tolist() == [[2, 1], [1, 1], [1, 2], [2, 2]]


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("square3", 1),
        ("ring_thick_right", 2),
        ("ring3", 1),  # the hole's cells are on the outer border already
        ("diamond", 1),
        ("two_rings_sharing_a_cell", 1),
        ("two_rooms", 2),
        ("nested", 2),
        ("inverted_V", 2),  # back at the start too early: two fragments
        ("inverted_V_long", 2),
        ("single", 0),  # a single cell is left out
    ],
)
def test_the_chapters_own_rules_and_where_they_fail(name: str, found: int) -> None:
    assert len(trace_borders(drawn(FIGURES[name][0]), tracer="chapter")) == found


def test_the_chapter_stops_at_its_first_cell_and_misses_the_rest() -> None:
    grid = drawn(FIGURES["corner_of_three"][0])
    assert trace_borders(grid)[0].cells.tolist() == [[1, 1], [0, 0], [1, 1], [1, 2]]
    assert trace_borders(grid, tracer="chapter")[0].cells.tolist() == [[1, 1], [0, 0]]


def test_the_chapter_is_right_on_walls_two_cells_thick() -> None:
    grid = np.zeros((30, 40), np.bool_)
    grid[3:27, 4:36] = True
    grid[5:25, 6:20] = grid[5:25, 22:34] = False
    assert sequences(trace_borders(grid, tracer="chapter")) == sequences(trace_borders(grid))


@pytest.mark.parametrize("tracer", ["closed", "chapter"])
@pytest.mark.parametrize("name", CLASSES)
def test_the_walk_takes_the_borders_cells_in_turn(name: str, tracer: str) -> None:
    grid = CLASSES[name](np.random.default_rng(3))
    for border in trace_borders(grid, tracer=tracer):  # type: ignore[arg-type]
        steps = list(walk_border(grid, border))
        cells = [tuple(cell) for cell in border.cells.tolist()]
        assert [step.cell for step in steps] == cells
        if len(cells) == 1:
            assert steps[0].following is None
            assert sorted(steps[0].tried) == list(range(8))
        else:
            assert [step.following for step in steps] == cells[1:] + cells[:1]


def test_a_grid_that_is_all_black_or_empty() -> None:
    assert trace_borders(np.zeros((5, 7), np.bool_)) == []
    assert trace_borders(np.zeros((0, 7), np.bool_)) == []
    assert [len(b.cells) for b in trace_borders(np.ones((5, 7), np.bool_))] == [20]


def test_thresholds_are_strict_and_a_layer_keeps_its_name() -> None:
    geometry = GridGeometry((0.0, 0.0), 0.1, 1, 5)
    probability = np.array([[0.5, 0.51, 0.55, 0.60, 0.61]], np.float32)
    layer = Layer("ping", "probability", geometry, probability, probability, probability > 0, {})
    counts = {t: int(threshold_layer(layer, t).occupied.sum()) for t in (0.5, 0.51, 0.55, 0.60)}
    assert counts == {0.5: 4, 0.51: 3, 0.55: 2, 0.60: 1}
    assert threshold_layer(layer, 0.55).layer == "ping"
    assert not threshold_layer(layer, 0.55).occupied.flags.writeable


def test_found_borders_are_numbered_in_scan_order_and_carry_the_geometry() -> None:
    geometry = GridGeometry((1.0, 2.0), 0.05, 7, 7)
    thresholded = Thresholded("fused", geometry, 0.55, drawn(FIGURES["nested"][0]))
    borders = find_borders(thresholded, BordersSection())
    assert [(b.number, b.outer, b.layer) for b in borders] == [
        (0, True, "fused"),
        (1, False, "fused"),
        (2, True, "fused"),
        (3, False, "fused"),
    ]
    assert all(b.geometry == geometry and not b.cells.flags.writeable for b in borders)
