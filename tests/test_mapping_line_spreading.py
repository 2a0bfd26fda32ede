"""From some cells to all others: against SciPy, which looks at them in another way."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from mapping.line_kernels.spreading import distances, spread

GRIDS = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=12))


@settings(deadline=None)  # it may have to be compiled
@given(GRIDS)
def test_distances_are_exact(cells: NDArray[np.bool_]) -> None:
    if cells.any():
        np.testing.assert_array_equal(distances(cells), distance_transform_edt(~cells))
    else:
        assert np.isinf(distances(cells)).all()


def test_distances_over_a_large_grid() -> None:
    cells = np.random.default_rng(1).random((200, 300)) < 0.001
    np.testing.assert_array_equal(distances(cells), distance_transform_edt(~cells))


@settings(deadline=None)  # it may have to be compiled
@given(GRIDS, st.integers(0, 2**32 - 1))
def test_what_hangs_together_with_a_seed_is_reached(cells: NDArray[np.bool_], seed: int) -> None:
    first = cells & (np.random.default_rng(seed).random(cells.shape) < 0.2)
    labels, _ = label(cells, np.ones((3, 3), int))
    mine = np.unique(labels[first])
    np.testing.assert_array_equal(spread(cells, first), np.isin(labels, mine[mine > 0]))
