"""Dots of which there are only ever more: a path, the echoes of a ranger.

Were each dot a row of its own, the viewer would gather thousands of rows at every step. Were all
dots so far one row, the file would grow with their square. So they are kept as numbers are
written: the newest lie in the row of the lowest digit, and whenever that is full, all of it moves
up a digit. The viewer then looks at one row a digit, and each dot is written a few times for each.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BASE = 16  # rows of one digit that make one of the next


class Trail:
    """``draw(digit, dots)`` is called for each row that changes; dots are (N, 2), metres."""

    def __init__(self, draw: Callable[[int, Floats], None]) -> None:
        self._draw = draw
        self._digits: list[list[Floats]] = []

    def add(self, dots_m: Floats) -> None:
        """Some more dots (N, 2)."""
        digit, moved = 0, np.asarray(dots_m, np.float64)
        while True:
            if digit == len(self._digits):
                self._digits.append([])
            rows = self._digits[digit]
            rows.append(moved)
            if len(rows) < BASE:
                self._draw(digit, np.concatenate(rows))
                return
            moved = np.concatenate(rows)
            rows.clear()
            self._draw(digit, np.zeros((0, 2)))
            digit += 1
