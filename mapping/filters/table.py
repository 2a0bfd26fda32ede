"""The reading filters by name: how many readings each looks at, and why it leaves one out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.parameters import Sensor
from recorder.columns import Floats

OFF, MEDIAN, AGREE, PREDICTED = "off", "median", "agree", "predicted"


@dataclass(frozen=True, slots=True)
class ReadingFilter:
    """``of`` readings are looked at where ``filter_of`` is not set.

    ``reason`` is what a rejected reading is counted by, ``explained`` a sentence on what a step
    shows, with the range that was expected in place of ``{}``.
    """

    name: str
    of: int
    reason: str
    explained: str


FILTERS: dict[str, ReadingFilter] = {
    each.name: each
    for each in (
        ReadingFilter(
            MEDIAN, 3, "far from the median of the last ones (filter)",
            "The median of the last {of} readings of {sensor} is {expected}.",
        ),
        ReadingFilter(
            AGREE, 2, "does not agree with the ones before (filter)",
            "Just before {sensor} measured {expected}: the last {of} do not agree.",
        ),
        ReadingFilter(
            PREDICTED, 3, "contradicts the map so far (filter)",
            "The map so far predicts {expected}.",
        ),
    )
}  # fmt: skip
REJECTING = tuple(each.reason for each in FILTERS.values())


@dataclass(frozen=True, slots=True)
class Verdicts:
    """Which readings are left out, (N,), and what range was expected in place of theirs (NaN)."""

    rejected: NDArray[np.bool_]
    expected_m: Floats

    @classmethod
    def none(cls, count: int) -> Verdicts:
        """All are kept."""
        return cls(np.zeros(count, np.bool_), np.full(count, np.nan))

    def of(self, rows: NDArray[np.bool_]) -> Verdicts:
        """Those of some readings."""
        return Verdicts(self.rejected[rows], self.expected_m[rows])

    def joined(self, other: Verdicts) -> Verdicts:
        """Both: what either rejects is left out."""
        expected_m = np.where(self.rejected, self.expected_m, other.expected_m)
        return Verdicts(self.rejected | other.rejected, expected_m)


def length_of(sensor: Sensor) -> int:
    """How many readings in a row the filter of a sensor looks at."""
    if sensor.filter == OFF:
        return 1
    return sensor.filter_of or FILTERS[sensor.filter].of


def tolerance_m(sensor: Sensor, expected_m: Floats) -> Floats:
    """By how much readings may differ from the ranges that were expected of them (N,), metres.

    As much as is configured, or by the sensor's own error where that is more. To have seen nothing
    (+Inf) differs from any range.
    """
    finite_m = np.where(np.isfinite(expected_m), expected_m, 0.0)
    return np.maximum(sensor.range_error * finite_m, sensor.filter_within_m)
