"""How many readings of a sensor did not come, by the pace of those that did.

Lost lines are counted for the whole link, by their sequence numbers; which sensor they were of
nobody can say. A steady sensor shows it all the same: a pause of three usual steps misses two.
"""

from __future__ import annotations

import statistics
from collections import deque

_REMEMBERED = 15
_ENOUGH = 5
_LATE = 0.6  # of a step, before a reading counts as missing


class Cadence:
    """The pace of one sensor; ``missing`` is an estimate, and 0 until the pace is known."""

    def __init__(self) -> None:
        self.missing = 0
        self._steps_ns: deque[int] = deque(maxlen=_REMEMBERED)
        self._last_ns: int | None = None

    def reading(self, t_ns: int) -> None:
        """One came, measured at ``t_ns``."""
        last_ns, self._last_ns = self._last_ns, t_ns
        if last_ns is None:
            return
        step_ns = t_ns - last_ns
        if len(self._steps_ns) >= _ENOUGH:
            usual_ns = statistics.median(self._steps_ns)
            if usual_ns > 0:
                self.missing += max(int(step_ns / usual_ns + 1.0 - _LATE) - 1, 0)
        self._steps_ns.append(step_ns)
