"""The readings that filters left out, each to be shown before the reading that came next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mapping.artifacts import RejectedReading
from mapping.filters.table import FILTERS, Verdicts, length_of
from mapping.readings import Readings

MOST_SHOWN = 100_000


class Rejections:
    """Rejected readings of a session so far, in order; of very many the first ones."""

    def __init__(self) -> None:
        self._before: dict[int, list[tuple[Readings, int, float]]] = {}
        self._count = 0

    def take(self, readings: Readings, verdicts: Verdicts) -> None:
        """Note which of these readings (N,) were left out; the others count on from the first."""
        rejected, expected_m = verdicts.rejected, verdicts.expected_m
        number = readings.first_number + np.cumsum(~rejected)
        for row in np.flatnonzero(rejected)[: MOST_SHOWN - self._count].tolist():
            self._count += 1
            waiting = self._before.setdefault(int(number[row]), [])
            waiting.append((readings[row : row + 1], int(number[row]), float(expected_m[row])))

    def before(self, number: int) -> Iterator[RejectedReading]:
        """Those that came between the reading before this one and this one."""
        for reading, next_number, expected_m in self._before.get(number, ()):
            sensor = reading.sensors[reading.sensor[0]]
            known = FILTERS[sensor.filter]
            beam = replace(reading.beam(0), number=next_number)
            yield RejectedReading(beam, known.reason, expected_m, sensor.filter, length_of(sensor))
