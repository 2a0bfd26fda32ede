"""`pooled`: eight sums of evidence a cell, in a logistic function of their logarithms.

Added up like Bayes, the hundredth ping from one corner counts as much as the first, though it
repeats the first one's error; its logarithm hardly grows. The weights are learned from rooms whose
walls are known (``python -m benchmarks.pooled_weights``), one set for each medium.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from mapping.artifacts import TempGrid
from mapping.numbers import expit
from mapping.update_rules.base import Cells, Floats, UpdateRule
from mapping.update_rules.pooled_weights import MEDIUM, Weights, given_weights, weights_of
from mapping.update_rules.saturating import in_steps
from recorder.errors import BadInput
from recorder.sensors import SensorKind

NEAR_M, MIDDLE_M = 0.2, 0.4  # misses nearer than the first, and from there to the second
BEFORE_ARC_M = 0.15  # misses so close before an arc
THIN, THIN_M = 0.01, 0.01  # the arc itself ends so much behind the range, relative and in metres
FARTHEST_MISS_M, FARTHEST_HIT_M = 0.6, 1.5  # the nearest ones count no farther than this
LIMITS = NEAR_M, MIDDLE_M, BEFORE_ARC_M, THIN, THIN_M, FARTHEST_MISS_M
"""What the kernel is given of these, in its order."""
LEAST = 0.01  # hits and misses together: what one reading at 7 m counts
MOST = 13.8  # log-odds that no sums pass
_HALF_DIAGONAL = 0.7072
_ROUNDING_M = 1e-9


class Pooled(UpdateRule):
    """Log-odds = bias + the sum of weight times ln(1 + sum), over eight sums of each cell.

    ``hits`` and ``misses`` count readings as 1 / (1 + (r / fade)^2), r being the range of a hit
    and the distance of a cell that was passed through; ``on_arc`` are hits on the arc itself, not
    in the band behind it; ``before_arc`` misses in the last 15 cm before an arc; ``misses_near``
    and ``misses_middle`` those nearer than 0.2 m and 0.4 m. ``nearest_miss_m`` and
    ``nearest_hit_m`` are the least range of either, taken as they are. A cell that was never hit
    is not rather occupied. One that no beam passed through is not rather free, and of a sonar not
    surely occupied: that lies behind walls, mostly. Sums of whole steps and least values are the
    same in any order, and those of two maps give the map of both.
    """

    name = "pooled"
    per_sample = False
    needs_a_view = True
    ignores = frozenset({"regions", "gaussian", "p_hit", "p_miss", "hit", "miss", "near", "fade_m"})
    start: ClassVar[dict[str, float]] = {
        "hits": 0.0, "misses": 0.0, "on_arc": 0.0, "before_arc": 0.0, "misses_near": 0.0,
        "misses_middle": 0.0, "nearest_miss_m": FARTHEST_MISS_M, "nearest_hit_m": FARTHEST_HIT_M,
    }  # fmt: skip

    class Parameters(UpdateRule.Parameters):
        weights: str | dict[str, float | dict[str, float]] = Field(
            "", description="sonar, infrared, laser, a TOML file of weights, or a table of them"
        )

        @field_validator("weights")
        @classmethod
        def _can_be_used(cls, weights: Any) -> Any:
            if isinstance(weights, dict):
                try:
                    given_weights(weights)
                except BadInput as error:
                    raise ValueError(str(error)) from None
            return weights

    def usual(self, kind: SensorKind) -> dict[str, Any]:
        return {"weights": MEDIUM[kind.radiation]}

    @property
    def learned(self) -> Weights:
        """The weights in force. Raises BadInput where their file cannot be used."""
        given = self.parameters.weights
        return weights_of(given or "sonar") if isinstance(given, str) else given_weights(given)

    def merge(self, cells: Cells, temp: TempGrid) -> None:
        x_m, y_m, rho, range_m = _distances(temp)
        band, arc_end = temp.band, arc_end_m(range_m, temp.geometry.resolution_m)
        band = band & np.isfinite(range_m)
        free = temp.free & (temp.probability != 0.5) & ~band
        fade_m = self.learned.fade_m
        seen = np.isfinite(range_m) & (range_m <= temp.beam.mark_to_m)
        faded = np.square(x_m * (1.0 / fade_m))[None, :] + np.square(y_m * (1.0 / fade_m))[:, None]
        cells["hits"] += np.where(band, in_steps(1.0 / (1.0 + np.square(range_m / fade_m))), 0.0)
        cells["misses"] += np.where(free, in_steps(1.0 / (1.0 + faded)), 0.0)
        cells["on_arc"] += band & (rho <= arc_end + _ROUNDING_M)
        cells["before_arc"] += free & seen & (rho > range_m - BEFORE_ARC_M)
        cells["misses_near"] += free & (rho < NEAR_M)
        cells["misses_middle"] += free & (rho >= NEAR_M) & (rho < MIDDLE_M)
        for name, those, metres in (
            ("nearest_miss_m", free, rho), ("nearest_hit_m", band, range_m),
        ):  # fmt: skip
            np.minimum(cells[name], metres, out=cells[name], where=those)

    def values(self, cells: Cells) -> Floats:
        total = self._held(cells, self._unheld(cells))
        return expit(MOST * np.tanh(total / MOST))

    def _unheld(self, cells: Cells) -> Floats:
        total = np.full(cells["hits"].shape, self.learned.bias)
        for term in self._weighted(cells).values():
            total += term
        return total

    def _held(self, cells: Cells, unheld: Floats) -> Floats:
        # Less than one reading at the farthest is left where a map forgets.
        total = unheld * np.minimum((cells["hits"] + cells["misses"]) / LEAST, 1.0)
        total = np.where(cells["hits"] == 0.0, np.minimum(total, 0.0), total)
        held = np.clip(total, 0.0, self.learned.most_unpassed)
        return np.where(cells["misses"] == 0.0, held, total)

    def terms(self, cells: Cells) -> dict[str, Floats]:
        """As :class:`UpdateRule` has it; ``limits`` is what a cell is held back by: one without
        hits, and one that no beam passed through yet."""
        unheld = self._unheld(cells)
        named = {
            name.removesuffix("_m").replace("_", " "): term
            for name, term in self._weighted(cells).items()
        }
        return {**named, "limits": self._held(cells, unheld) - unheld}

    def _weighted(self, cells: Cells) -> dict[str, Floats]:
        of = self.learned.of
        return {
            name: of[name] * (array if name.startswith("nearest") else np.log1p(array))
            for name, array in cells.items()
        }


def arc_end_m(range_m: Floats, cell_m: float) -> Floats:
    """How far from the sensor the cells of the arc itself end: those that it runs through."""
    return range_m * (1.0 + THIN) + max(THIN_M, _HALF_DIAGONAL * cell_m)


def _distances(temp: TempGrid) -> tuple[Floats, Floats, Floats, Floats]:
    """How far columns, rows and cells are from the sensor, and the range of the nearest axis."""
    (x0, y0), size, window = temp.geometry.origin_m, temp.geometry.resolution_m, temp.window
    origin, beam = temp.beam.world_from_sensor, temp.beam
    x_m = (np.arange(window.cols, dtype=np.float64) + window.col0 + 0.5) * size + x0 - origin.x_m
    y_m = (np.arange(window.rows, dtype=np.float64) + window.row0 + 0.5) * size + y0 - origin.y_m
    rho: Floats = np.sqrt(np.square(x_m)[None, :] + np.square(y_m)[:, None])
    if len(beam.ranges_m) == 1:
        return x_m, y_m, rho, np.full(rho.shape, float(beam.ranges_m[0]))
    directions = np.arctan2(y_m[:, None], x_m[None, :])
    return x_m, y_m, rho, beam.ranges_m[_nearest_axis(directions, beam.headings_rad)]


def _nearest_axis(directions_rad: Floats, headings_rad: Floats) -> NDArray[np.int64]:
    """The axis that looks most nearly in each direction."""
    turns = headings_rad % (2.0 * math.pi)
    order = np.argsort(turns, kind="stable")
    borders = turns[order][:-1] + np.diff(turns[order]) / 2.0
    last_to_first = (turns[order[-1]] + turns[order[0]] + 2.0 * math.pi) / 2.0
    at = np.searchsorted(borders, directions_rad % (2.0 * math.pi))
    wanted = directions_rad % (2.0 * math.pi)
    if last_to_first < 2.0 * math.pi:
        at = np.where(wanted > last_to_first, 0, at)
    else:
        at = np.where(wanted < last_to_first - 2.0 * math.pi, len(order) - 1, at)
    return np.asarray(order[at], np.int64)
