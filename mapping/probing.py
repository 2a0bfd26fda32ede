"""Why does this cell look as it does? One cell, followed through a run.

A probe takes the artifacts as they come and keeps each reading that reached its cell: what its
evidence there was, and what the cell's belief was before and after.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mapping.artifacts import Artifact, MergedGrid, Snapshot, Started, TempGrid
from mapping.beams import Beam
from mapping.grid import GridGeometry, Window
from recorder.errors import BadInput

OBSTACLE, EMPTY, BEHIND, BESIDE = "obstacle", "empty", "behind", "beside"
ZONES = (OBSTACLE, EMPTY, BEHIND, BESIDE)
_TOLERANCE_RAD = 1e-9


@dataclass(frozen=True, slots=True)
class Touch:
    """One reading that reached the cell, and its effect there.

    ``zone`` is where in the beam the cell's centre lies: in the band where the obstacle may be,
    in the empty part before it, behind it (where the reading is no evidence), or beside the beam
    with the cell changed all the same. ``range_m`` is that of the beam's axis nearest to the cell
    (+Inf: it saw nothing), ``distance_m`` from the sensor to the cell's centre. ``evidence``,
    ``before`` and ``after`` are probabilities of being occupied; NaN for a reading that ended
    before the cell, when no other had yet reached it. ``moved_by`` are the sums that
    changed there, of a rule of several, and by how much log-odds each. ``model`` names which of
    several models of its sensor, by range, the reading is judged by.
    """

    reading: int
    t_ns: int
    layer: str
    sensor: str
    range_m: float
    distance_m: float
    zone: str
    evidence: float
    before: float
    after: float
    moved_by: tuple[tuple[str, float], ...] = ()
    model: str = ""

    @property
    def effect(self) -> float:
        """How much more occupied (above 0) or free the reading made the cell, as a probability."""
        return 0.0 if self.zone == BEHIND else self.after - self.before


class CellProbe:
    """Follows the cell that holds a point (x, y) of the map frame, metres.

    Call it with each artifact of a run. ``touches`` are the readings that reached the cell,
    ``beliefs`` the newest probability of each layer that has evidence for it, ``observed`` the
    layers whose map holds the cell as seen.
    """

    def __init__(self, at_m: tuple[float, float]) -> None:
        self.at_m = at_m
        self.touches: list[Touch] = []
        self.beliefs: dict[str, float] = {}
        self.observed: set[str] = set()
        self.cell = (0, 0)
        self.centre_m = at_m
        self._temp: TempGrid | None = None

    def __call__(self, artifact: Artifact) -> None:
        """Follow one artifact. Raises BadInput at the first when the cell is outside the grid."""
        match artifact:
            case Started():
                self._find(artifact.geometry)
            case TempGrid():
                self._temp = artifact
            case MergedGrid():
                self._merged(artifact)
            case Snapshot():
                layer = artifact.layer
                self.beliefs[layer.name] = float(layer.probability[self.cell])
                if layer.observed[self.cell]:
                    self.observed.add(layer.name)

    def strongest(self, count: int, layer: str | None = None) -> list[Touch]:
        """The readings with the largest effect, of one layer or of all, the largest first."""
        mine = [t for t in self.touches if layer in (None, t.layer)]
        return sorted(mine, key=lambda t: (-abs(t.effect), t.reading))[:count]

    def counts(self, layer: str | None = None) -> dict[str, int]:
        """How many readings reached the cell in each zone."""
        mine = [t.zone for t in self.touches if layer in (None, t.layer)]
        return {zone: mine.count(zone) for zone in ZONES}

    def _find(self, geometry: GridGeometry) -> None:
        if not np.isfinite(self.at_m).all():
            raise BadInput(outside(self.at_m, geometry))
        cell = geometry.cells_of(np.array([self.at_m], np.float64))
        if not geometry.contains(cell)[0]:
            raise BadInput(outside(self.at_m, geometry))
        self.cell = (int(cell[0, 0]), int(cell[0, 1]))
        x, y = geometry.centres_of(cell)[0]
        self.centre_m = (float(x), float(y))

    def _merged(self, merged: MergedGrid) -> None:
        beam, inside = merged.beam, _inside(self.cell, merged.window)
        before = after = self.beliefs.get(merged.layer, math.nan)
        if inside is not None:
            before, after = float(merged.previous[inside]), float(merged.probability[inside])
            self.beliefs[merged.layer] = after
        axis, angle, distance = _in_beam(beam, self.centre_m)
        zone = self._zone(beam, axis, angle, distance)
        changed = inside is not None and before != after
        if zone is None and not changed:
            return
        if zone != BEHIND:
            self.observed.add(merged.layer)
        here = (
            None if inside is None or self._temp is None else _inside(self.cell, self._temp.window)
        )
        evidence = 0.5 if here is None or self._temp is None else self._temp.probability[here]
        self.touches.append(
            Touch(
                reading=beam.number, t_ns=beam.t_ns, layer=merged.layer, sensor=beam.sensor,
                range_m=float(beam.ranges_m[axis]), distance_m=distance, zone=zone or BESIDE,
                evidence=evidence, before=before, after=after,
                moved_by=merged.sums.changes(*inside) if inside and merged.sums else (),
                model=beam.model,
            )
        )  # fmt: skip

    def _zone(self, beam: Beam, axis: int, angle: float, distance: float) -> str | None:
        """Where in the newest beam the cell lies; None where the reading did not reach it."""
        grids = () if self._temp is None else (self._temp, *self._temp.sub_grids)
        parts = [(grid, _inside(self.cell, grid.window)) for grid in grids]
        if any(here is not None and grid.band[here] for grid, here in parts):
            return OBSTACLE
        if any(here is not None and grid.free[here] for grid, here in parts):
            return EMPTY
        within = angle <= beam.beam_width_rad / 2.0 + _TOLERANCE_RAD
        behind = beam.ranges_m[axis] < distance <= np.max(beam.reach_m)
        return BEHIND if within and behind else None


def outside(at_m: Sequence[float], geometry: GridGeometry) -> str:
    """Why a point has no cell, in one line."""
    (x, y), (width, height) = geometry.origin_m, geometry.size_m
    return (
        f"--probe {at_m[0]:g},{at_m[1]:g} is outside the grid, which covers "
        f"x {x:.3f} to {x + width:.3f} m, y {y:.3f} to {y + height:.3f} m"
    )


def _inside(cell: tuple[int, int], window: Window) -> tuple[int, int] | None:
    """The cell's index in an array over the window."""
    row, col = cell[0] - window.row0, cell[1] - window.col0
    return (row, col) if 0 <= row < window.rows and 0 <= col < window.cols else None


def _in_beam(beam: Beam, point_m: tuple[float, float]) -> tuple[int, float, float]:
    """Number of the axis nearest to a point, the angle between them, the point's distance."""
    dx, dy = point_m[0] - beam.world_from_sensor.x_m, point_m[1] - beam.world_from_sensor.y_m
    apart = np.remainder(math.atan2(dy, dx) - beam.headings_rad + math.pi, 2 * math.pi) - math.pi
    axis = int(np.argmin(np.abs(apart)))
    return axis, abs(float(apart[axis])), math.hypot(dx, dy)
