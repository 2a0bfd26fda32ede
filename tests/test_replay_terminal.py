"""The map in the terminal: which way up, which character, how wide."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.artifacts import Finished
from replay.terminal import picture, summary_lines


def test_the_highest_y_is_on_top_and_two_rows_share_a_line() -> None:
    wall, free, unknown, unsure = 0.9, 0.1, 0.5, 0.52
    rows = [
        [wall, free, unknown, unsure],  # lowest y
        [wall, wall, unknown, unsure],
        [free, free, unknown, free],
        [free, wall, wall, free],  # highest y
    ]
    assert picture(np.array(rows)) == " ▀▀ \n█▀·░"


def test_observed_decides_what_is_unknown() -> None:
    probability = np.array([[0.0, 0.5], [0.0, 0.5]], np.float32)
    seen = np.array([[False, True], [False, True]])
    assert picture(probability, seen) == "·░"
    assert picture(probability) == " ·"


@pytest.mark.parametrize("width", [1, 10, 72, 500])
def test_it_fits_the_width_and_keeps_a_thin_wall(width: int) -> None:
    probability = np.full((101, 203), 0.1)
    probability[:, 57] = 0.95
    lines = picture(probability, width=width).splitlines()
    assert {len(line) for line in lines} == {len(lines[0])}
    assert len(lines[0]) <= width
    step = -(-203 // width)
    assert len(lines) == -(-101 // (2 * step))
    assert all(line[57 // step] in "█▀" for line in lines)


def test_an_empty_grid_is_an_empty_picture() -> None:
    assert picture(np.zeros((0, 5))) == ""


def test_the_summary_leaves_out_what_did_not_happen() -> None:
    done = Finished(12, {"ping": 7, "dirrs": 3}, {"pose gap": 2, "out of range": 0})
    assert summary_lines(done) == [
        "12 readings, used: ping 7, dirrs 3",
        "dropped: pose gap 2",
    ]
    assert summary_lines(Finished(0, {}, {})) == ["0 readings, used: none"]
