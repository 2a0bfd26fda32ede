"""Evidence that fades while time passes: for what moved, or may have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mapping.grid import Window
from mapping.update_rules.base import Cells, Floats


class Forgetting:
    """Draws cells towards what they began with: half of the way in each ``half_life_s``.

    ``start`` is what each array of a rule begins with. A cell is drawn when a reading comes to its
    window, and never when somebody looks, so looking changes no byte. The newest reading's time
    is now; time that steps back stands still.
    """

    def __init__(
        self, half_life_s: float, start: Mapping[str, float], shape: tuple[int, int]
    ) -> None:
        self.now_ns = 0
        self._half_life_ns = half_life_s * 1e9
        self._start = dict(start)
        self._drawn_ns = np.zeros(shape, np.int64)

    def draw(self, cells: Cells, window: Window, t_ns: int) -> None:
        """Bring a window of ``cells``, the arrays over it, to a time, in place."""
        self.now_ns = max(self.now_ns, t_ns)
        faded = self.faded(cells, window)
        for name, array in cells.items():
            array[...] = faded[name]
        self._drawn_ns[window.slices] = self.now_ns

    def faded(self, cells: Cells, window: Window) -> Cells:
        """The arrays over a window as they are now; a copy."""
        share = self._share_left(window)
        return {
            name: self._start[name] + (array - self._start[name]) * share
            for name, array in cells.items()
        }

    def _share_left(self, window: Window) -> Floats:
        passed_ns = (self.now_ns - self._drawn_ns[window.slices]).astype(np.float64)
        share: Floats = np.exp2(-passed_ns / self._half_life_ns)
        return share
