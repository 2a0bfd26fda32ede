"""Rules and models that each break some law, for the regression tests of the laws."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mapping.sensor_model import SensorModel
from mapping.sensor_model.models import Peak
from mapping.update_rules import UpdateRule


class _Score(UpdateRule):
    start: ClassVar = {"score": 0.0}

    def merge(self, cells, temp):
        cells["score"] += temp.probability - 0.5

    def values(self, cells):
        return cells["score"]

    def probability(self, cells, largest):
        return np.clip(0.5 + cells["score"] / 20, 0, 1)


class Good(_Score):
    name = "good"


class LastWord(_Score):
    name = "last-word"

    def merge(self, cells, temp):
        said = temp.probability != 0.5
        cells["score"][said] = temp.probability[said]


class Spills(_Score):
    name = "spills"

    def merge(self, cells, temp):
        cells["score"] += 1e-3


class SpillsOne(_Score):
    name = "spills-one"

    def merge(self, cells, temp):
        super().merge(cells, temp)
        covered = temp.band | temp.free
        if not covered.all():
            row, col = np.argwhere(~covered)[0]
            cells["score"][row, col] += 0.5


class Backwards(_Score):
    name = "backwards"

    def merge(self, cells, temp):
        cells["score"] -= temp.probability - 0.5


class OnlyUp(_Score):
    name = "only-up"

    def merge(self, cells, temp):
        cells["score"] += np.abs(temp.probability - 0.5)


class Unbounded(_Score):
    name = "unbounded"

    def probability(self, cells, largest):
        return 0.5 + cells["score"] * 3


class Explodes(_Score):
    name = "explodes"

    def merge(self, cells, temp):
        with np.errstate(over="ignore"):
            cells["score"] *= 1e30
        super().merge(cells, temp)

    def values(self, cells):
        with np.errstate(over="ignore"):
            return np.exp(cells["score"] * 100)


class Sticks(_Score):
    name = "sticks"

    def merge(self, cells, temp):
        free = np.abs(cells["score"]) < 40
        cells["score"][free] += temp.probability[free] - 0.5


class Shared(_Score):
    name = "shared"
    _kept: ClassVar[list] = []

    def merge(self, cells, temp):
        super().merge(cells, temp)
        self._kept.append(1)
        cells["score"] += len(self._kept) * 1e-3 * temp.band


class Raises(_Score):
    name = "raises"

    def merge(self, cells, temp):
        raise ValueError("no  such\nthing")


class ToldOrder(LastWord):
    name = "told-order"
    order_matters = True


class LateBand(Peak):
    name = "late-band"

    def band(self, sensor):
        return 0.1, -0.2


class WideBand(Peak):
    name = "wide-band"

    def band(self, sensor):
        return 1.2, 0.1


class EndlessBand(Peak):
    name = "endless-band"

    def band(self, sensor):
        return 0.1, np.inf


class OneNumber(SensorModel):
    name = "one-number"

    def occupied(self, sensor, beam_cells):
        return np.array([0.6])


class TooSure(SensorModel):
    name = "too-sure"

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 1.1, 0.1)


class Inverted(SensorModel):
    name = "inverted"

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 0.4, 0.6)


class HalfInverted(SensorModel):
    name = "half-inverted"

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 0.6, 0.5 + 1e-6)


class LeftHanded(SensorModel):
    name = "left-handed"

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 0.7 + 0.1 * np.sign(beam_cells.across_m), 0.4)


class Neighbours(SensorModel):
    name = "neighbours"

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 0.5 + 0.4 / max(len(beam_cells.rho_m), 1), 0.4)


class Writes(SensorModel):
    name = "writes"

    def occupied(self, sensor, beam_cells):
        beam_cells.rho_m[:] = 0
        return np.full(len(beam_cells.rho_m), 0.5)


class ByPlace(SensorModel):
    name = "by-place"

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 0.5 + 0.2 * np.exp(-beam_cells.rho_m), 0.45)
