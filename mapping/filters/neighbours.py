"""Filters that hold a range against those that the same sensor measured just before.

They look back only, so that a live map is the one of the finished session; and they leave readings
out and never replace one: a median of earlier ranges, put where the robot stands now, would draw a
wall where none was measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mapping.filters.table import AGREE, MEDIAN, Verdicts, length_of, tolerance_m
from mapping.parameters import Sensor
from recorder.columns import Floats, Ints


class Neighbours:
    """The filters ``median`` and ``agree`` of all sensors, from one block of readings to the next.

    Until a sensor has measured as often as its filter looks at, all its readings are kept.
    """

    def __init__(self) -> None:
        self._last_m: dict[str, Floats] = {}  # of each sensor, the newest last

    def take(
        self,
        ranges_m: Floats,
        sensor: Ints,
        measured: NDArray[np.bool_],
        sensors: Sequence[Sensor],
    ) -> Verdicts:
        """Judge the readings (N,) of a block; only those that were ``measured`` are neighbours.

        A range of +Inf saw nothing, and is a neighbour too.
        """
        found = Verdicts.none(len(ranges_m))
        for number, each in enumerate(sensors):
            if each.filter not in _JUDGES:
                continue
            rows = np.flatnonzero((sensor == number) & measured)
            before_m = self._last_m.get(each.name, np.zeros(0))
            row_m, length = np.concatenate([before_m, ranges_m[rows]]), length_of(each)
            self._last_m[each.name] = row_m[max(len(row_m) - length + 1, 0) :]
            if len(row_m) >= length:
                judged = rows[length - 1 - len(before_m) :]
                windows_m = np.lib.stride_tricks.sliding_window_view(row_m, length)
                rejected, expected_m = _JUDGES[each.filter](windows_m, each)
                found.rejected[judged], found.expected_m[judged] = rejected, expected_m
        return found


def _by_median(windows_m: Floats, sensor: Sensor) -> tuple[NDArray[np.bool_], Floats]:
    """Whether the last of each window (M, of) is far from its median; of two the nearer one."""
    middle = (windows_m.shape[1] - 1) // 2
    median_m = np.sort(windows_m, axis=1)[:, middle]
    return differ(windows_m[:, -1], median_m, sensor), median_m


def _by_agreement(windows_m: Floats, sensor: Sensor) -> tuple[NDArray[np.bool_], Floats]:
    """Whether the last of each window (M, of) differs from any before it, the newest such one."""
    newest_m, expected_m = windows_m[:, -1], np.full(len(windows_m), np.nan)
    rejected = np.zeros(len(windows_m), np.bool_)
    for before in range(windows_m.shape[1] - 1):
        other_m = windows_m[:, before]
        apart = differ(newest_m, other_m, sensor)
        rejected |= apart
        expected_m[apart] = other_m[apart]
    return rejected, expected_m


def differ(ranges_m: Floats, expected_m: Floats, sensor: Sensor) -> NDArray[np.bool_]:
    """Which ranges (N,) are not what was expected; to have seen nothing twice is the same."""
    with np.errstate(invalid="ignore"):  # inf - inf: not more than anything
        apart: NDArray[np.bool_] = np.abs(ranges_m - expected_m) > tolerance_m(sensor, expected_m)
    return apart


def differs(range_m: float, expected_m: float, sensor: Sensor) -> bool:
    """The same of one range."""
    return bool(differ(np.array([range_m]), np.array([expected_m]), sensor)[0])


_JUDGES: dict[str, Callable[[Floats, Sensor], tuple[NDArray[np.bool_], Floats]]] = {
    MEDIAN: _by_median, AGREE: _by_agreement,
}  # fmt: skip
