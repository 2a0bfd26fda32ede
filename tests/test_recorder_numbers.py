"""What is ours for the sake of a quick start gives what NumPy gives, the same numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorder.numbers import distinct, median

FEW = st.integers(-3, 3) | st.integers(-(1 << 62), 1 << 62)
FLOATS = st.sampled_from([-0.5, 0.0, 0.1, 0.3, 2.0]) | st.floats(allow_nan=False)


@given(st.lists(FEW))
def test_distinct_ones_of_whole_numbers(numbers: list[int]) -> None:
    given = np.array(numbers, np.int64)
    assert distinct(given).tolist() == np.unique(given).tolist()


@given(st.lists(FLOATS))
def test_distinct_ones_of_others(numbers: list[float]) -> None:
    given = np.array(numbers, np.float64)
    assert distinct(given).tolist() == np.unique(given).tolist()


@given(st.lists(FLOATS, min_size=1))
def test_medians(numbers: list[float]) -> None:
    given = np.array(numbers, np.float64)
    with np.errstate(all="ignore"):
        assert np.array_equal(median(given), np.median(given), equal_nan=True)


@given(st.lists(FEW, min_size=1))
def test_medians_of_whole_numbers(numbers: list[int]) -> None:
    given = np.array(numbers, np.int64)
    assert median(given) == float(np.median(given))


@pytest.mark.parametrize("numbers", [[], [1.0, math.nan], [math.nan]])
def test_there_may_be_no_median(numbers: list[float]) -> None:
    assert math.isnan(median(np.array(numbers, np.float64)))
