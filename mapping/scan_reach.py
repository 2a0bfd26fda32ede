"""How far the beams of scans that came back empty may clear.

A beam out of a window, or past the laser's strength, comes back from nowhere: all that is known is
that nothing stood where other beams would have found it. So it clears no farther than the farthest
return of beams nearby that looked the same way; where none of these came back, no farther than the
nearest ones on either side. Scans are taken in their order and know of those before them, so a map
comes to the same while a session is recorded and afterwards.
"""

from __future__ import annotations

import math

import numpy as np

from mapping.parameters import Sensor
from recorder.columns import Floats, Ints
from recorder.geometry import SE2

_PLACE_M = 0.5  # side of the squares that beams start in; those of the eight around are near, too
_DIRECTIONS = 120  # of a full turn; one to either side counts as the same way


class ScanReach:
    """The farthest returns by place and direction, of all scans so far."""

    def __init__(self) -> None:
        self._farthest_m: dict[tuple[int, int], Floats] = {}

    def of_scan(
        self, world_from_sensor: SE2, bearings_rad: Floats, ranges_m: Floats, sensor: Sensor
    ) -> Floats:
        """Take a scan; returns how far each of its beams sees, and so clears without return, (N,).

        ``ranges_m`` (N,) are +Inf where nothing came back.
        """
        if sensor.clear_to_m is not None:
            return reach_of_rangers(ranges_m, sensor.max_range_m, sensor.clear_to_m)
        direction = _direction(bearings_rad + world_from_sensor.heading_rad)
        here = (
            math.floor(world_from_sensor.x_m / _PLACE_M),
            math.floor(world_from_sensor.y_m / _PLACE_M),
        )
        own_m = self._farthest_m.setdefault(here, np.zeros(_DIRECTIONS))
        seen = np.isfinite(ranges_m)
        np.maximum.at(own_m, direction[seen], ranges_m[seen])
        reach_m = np.full(len(ranges_m), sensor.max_range_m)
        if not seen.all():
            limit_m = _beside(self._near_m(here))
            reach_m[~seen] = np.minimum(limit_m[direction[~seen]], sensor.max_range_m)
        return reach_m

    def _near_m(self, here: tuple[int, int]) -> Floats:
        x, y = here
        around = [(x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        near = [self._farthest_m[place] for place in around if place in self._farthest_m]
        farthest: Floats = np.max(near, axis=0)
        return farthest


def reach_of_rangers(
    ranges_m: Floats, max_range_m: Floats | float, clear_to_m: Floats | float
) -> Floats:
    """How far readings (N,) see, where each goes by itself: no farther than it may clear if empty.

    The limits are the sensor's, one for all or one for each.
    """
    empty_m = np.minimum(max_range_m, clear_to_m)
    return np.where(np.isfinite(ranges_m), max_range_m, empty_m)


def _direction(headings_rad: Floats) -> Ints:
    turns = headings_rad / (2.0 * math.pi)
    return np.floor((turns - np.floor(turns)) * _DIRECTIONS).astype(np.int64) % _DIRECTIONS


def _beside(farthest_m: Floats) -> Floats:
    """The farthest return around each direction, or of the nearest ones that have any."""
    around = np.maximum(farthest_m, np.maximum(np.roll(farthest_m, 1), np.roll(farthest_m, -1)))
    found = np.flatnonzero(around > 0.0)
    if not len(found) or len(found) == len(around):
        return around
    every = np.arange(len(around))
    after = np.searchsorted(found, every)
    either = np.maximum(around[found[after % len(found)]], around[found[after - 1]])
    return np.where(around > 0.0, around, either)
