"""Where a cell is: points and cells there and back, windows, and what a cell begins with."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapping.grid import GridGeometry, Window, geometry_for
from recorder.errors import BadInput

RESOLUTIONS_M = st.sampled_from([0.01, 0.02, 0.05, 0.1, 0.3])
COORDINATES_M = st.floats(-50.0, 50.0)
GEOMETRIES = st.builds(
    GridGeometry,
    st.tuples(COORDINATES_M, COORDINATES_M),
    RESOLUTIONS_M,
    st.integers(1, 400),
    st.integers(1, 400),
)
CELLS = st.tuples(st.integers(-500, 500), st.integers(-500, 500))


def test_rows_go_up_and_columns_to_the_right() -> None:
    grid = GridGeometry((-1.0, 2.0), 0.5, 4, 6)
    points = np.array([[-1.0, 2.0], [-0.51, 2.0], [-0.49, 2.0], [1.9, 3.9], [-1.01, 1.99]])
    assert grid.cells_of(points).tolist() == [[0, 0], [0, 0], [0, 1], [3, 5], [-1, -1]]
    assert grid.contains(grid.cells_of(points)).tolist() == [True, True, True, True, False]
    assert grid.centres_of(np.array([[0, 0], [3, 5]])).tolist() == [[-0.75, 2.25], [1.75, 3.75]]
    assert grid.size_m == (3.0, 2.0)


@given(grid=GEOMETRIES, cell=CELLS)
def test_the_centre_of_a_cell_lies_in_it(grid: GridGeometry, cell: tuple[int, int]) -> None:
    cells = np.array([cell])
    assert grid.cells_of(grid.centres_of(cells)).tolist() == [list(cell)]
    row, col = cell
    inside = 0 <= row < grid.rows and 0 <= col < grid.cols
    assert grid.contains(cells).tolist() == [inside]


@given(grid=GEOMETRIES, x=COORDINATES_M, y=COORDINATES_M)
def test_a_point_lies_within_half_a_cell_of_its_cells_centre(
    grid: GridGeometry, x: float, y: float
) -> None:
    point = np.array([[x, y]])
    away = np.abs(grid.centres_of(grid.cells_of(point)) - point)
    assert away.max() <= grid.resolution_m / 2 + 1e-9


@given(grid=GEOMETRIES, corner=st.tuples(COORDINATES_M, COORDINATES_M), share=st.floats(0, 1))
def test_a_window_holds_all_cells_of_a_box_and_none_beyond_the_grid(
    grid: GridGeometry, corner: tuple[float, float], share: float
) -> None:
    low = np.array(corner)
    high = low + share * np.array(grid.size_m)
    window = grid.window_around(low, high)
    held = np.zeros(grid.shape, bool)
    held[window.slices] = True
    wanted = np.zeros(grid.shape, bool)
    (row0, col0), (row1, col1) = grid.cells_of(np.array([low, high]))
    rows, cols = np.indices(grid.shape)
    wanted[(rows >= row0) & (rows <= row1) & (cols >= col0) & (cols <= col1)] = True
    assert np.array_equal(held, wanted)
    assert window.empty == (not wanted.any())


@given(
    low=st.tuples(COORDINATES_M, COORDINATES_M),
    size=st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0)),
    resolution_m=RESOLUTIONS_M,
)
def test_a_fitted_grid_holds_the_box_and_its_margin_on_a_multiple_of_the_resolution(
    low: tuple[float, float], size: tuple[float, float], resolution_m: float
) -> None:
    high = np.add(low, size)
    grid = geometry_for(
        np.array(low), high, resolution_m=resolution_m, margin_m=0.2, max_cells=10**7
    )
    origin = np.array(grid.origin_m)
    assert (origin <= np.array(low) - 0.2 + 1e-9).all()
    assert (origin + grid.size_m >= high + 0.2 - 1e-9).all()
    assert (np.array(grid.size_m) <= np.array(size) + 0.4 + 2.0 * resolution_m + 1e-9).all()
    multiples = origin / resolution_m
    assert multiples == pytest.approx(np.round(multiples), abs=1e-6)


def test_a_grid_that_is_too_large_is_refused_with_its_size() -> None:
    with pytest.raises(BadInput, match=r"10000 x 10000 = 100,000,000 cells .*max_cells = 99"):
        geometry_for(np.zeros(2), np.full(2, 100.0), resolution_m=0.01, margin_m=0.0, max_cells=99)


@given(flags=st.lists(st.lists(st.booleans(), min_size=7, max_size=7), min_size=1, max_size=9))
def test_the_smallest_window_around_cells(flags: list[list[bool]]) -> None:
    cells: NDArray[np.bool_] = np.array(flags)
    window = Window.around(cells)
    places = [(row, col) for row, line in enumerate(flags) for col, on in enumerate(line) if on]
    assert window.empty == (not places)
    if places:
        rows, cols = zip(*places, strict=True)
        assert (window.row0, window.row0 + window.rows - 1) == (min(rows), max(rows))
        assert (window.col0, window.col0 + window.cols - 1) == (min(cols), max(cols))
