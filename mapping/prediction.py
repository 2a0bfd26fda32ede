"""What a reading would have been, had the map so far been the room.

Compared with what was measured it shows whether the map already knows the place: the two agree
where it does, and part where a wall is new, or where a reading is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Artifact, MergedGrid, Started
from mapping.beams import Beam
from mapping.grid import GridGeometry

SHORT, THROUGH = "short", "through"
_LEAST_GAP_M, _LEAST_GAP_SHARE = 0.10, 0.15  # of the range: what is less is no contradiction
_LEAST_AXES_SHARE = 0.33  # of a scan's axes: fewer that contradict the map are not the scan's fault


@dataclass(frozen=True, slots=True)
class Contradiction:
    """A reading and a map that cannot both be right.

    ``kind`` is :data:`SHORT`: it saw an obstacle and the map has none so near in the beam, or
    :data:`THROUGH`: the map has a wall on its axis before what it saw. ``expected_m`` is what
    the map says in the place of ``measured_m``; of a scan both are medians over the axes that
    contradict, which are ``share`` of all.
    """

    kind: str
    measured_m: float
    expected_m: float
    share: float = 1.0

    @property
    def weight(self) -> float:
        """How far the two are apart, metres; what should have been endless counts as far again."""
        expected_m = min(self.expected_m, 2.0 * self.measured_m + 1.0)
        return self.share * abs(expected_m - min(self.measured_m, 2.0 * expected_m + 1.0))


class RangePredictor:
    """Keeps which cells of each layer are occupied so far: probability above ``threshold``.

    Call it with each artifact of a run, and ask it at a :class:`Beam`, before that is merged.
    """

    def __init__(self, threshold: float) -> None:
        self._threshold = threshold
        self._geometry: GridGeometry | None = None
        self._occupied: dict[str, NDArray[np.bool_]] = {}

    def __call__(self, artifact: Artifact) -> None:
        """Follow one artifact."""
        if isinstance(artifact, Started):
            self._geometry = artifact.geometry
        elif isinstance(artifact, MergedGrid):
            occupied = self._layer(artifact.layer, artifact.geometry)
            occupied[artifact.window.slices] = artifact.probability > self._threshold

    def ranges_m(self, beam: Beam) -> NDArray[np.float64]:
        """What the beam's own layer predicts for each of its axes, (N,); +Inf: nothing is met.

        A ranger meets the nearest occupied cell of its whole cone, as sound comes back from
        whatever is nearest; a beam of a scan the first one on its axis. Distances are to the centre
        of the cell met.
        """
        geometry = self._geometry
        if geometry is None or beam.layer not in self._occupied:
            return np.full(len(beam.ranges_m), np.inf)
        return nearest_in_beam_m(beam, self._occupied[beam.layer], geometry)

    def contradiction(self, beam: Beam) -> Contradiction | None:
        """Whether a beam's own layer, as it is now, contradicts it; None where it does not.

        The cone of a ranger may hold a nearer wall that sends no echo back, so only one on its axis
        counts against it.
        """
        if self._geometry is None or beam.layer not in self._occupied:
            return None
        far_m, saw = beam.far_m, beam.saw_something
        gap_m = np.maximum(_LEAST_GAP_M, _LEAST_GAP_SHARE * far_m)
        nearest_m = self.ranges_m(beam)
        on_axis_m = nearest_on_axes_m(beam, self._occupied[beam.layer], self._geometry)
        short = saw & (nearest_m > far_m + gap_m)
        through = ~short & (on_axis_m < far_m - gap_m)
        share = float((short | through).mean())
        if share < _LEAST_AXES_SHARE:
            return None
        kind = SHORT if short.sum() >= through.sum() else THROUGH
        those, expected_m = (short, nearest_m) if kind == SHORT else (through, on_axis_m)
        return Contradiction(
            kind, float(np.median(far_m[those])), float(np.median(expected_m[those])), share
        )

    def _layer(self, name: str, geometry: GridGeometry) -> NDArray[np.bool_]:
        if name not in self._occupied:
            self._occupied[name] = np.zeros(geometry.shape, np.bool_)
        return self._occupied[name]


def nearest_in_beam_m(
    beam: Beam, occupied: NDArray[np.bool_], geometry: GridGeometry
) -> NDArray[np.float64]:
    """How far each axis of a beam gets before it meets an occupied cell (rows, cols), (N,).

    Of a ranger the nearest cell of its whole cone counts; metres, +Inf: nothing is met.
    """
    from mapping.kernels.loops import nearest_in_cone, nearest_on_rays

    x, y = _in_cells(beam, geometry)
    beyond = abs(x) + abs(y) + geometry.rows + geometry.cols  # no cell is further away
    reach = min(float(np.max(beam.reach_m)) / geometry.resolution_m, beyond)
    if len(beam.ranges_m) == 1:
        half = beam.beam_width_rad / 2.0
        heading = float(beam.headings_rad[0])
        cells = np.array([nearest_in_cone(occupied, x, y, heading, half, reach)])
    else:
        cells = nearest_on_rays(occupied, x, y, beam.headings_rad, reach)
    metres: NDArray[np.float64] = cells * geometry.resolution_m
    return metres


def nearest_on_axes_m(
    beam: Beam, occupied: NDArray[np.bool_], geometry: GridGeometry
) -> NDArray[np.float64]:
    """The same along the axes alone, no farther than each of them got."""
    from mapping.kernels.loops import nearest_on_rays

    x, y = _in_cells(beam, geometry)
    reach = float(beam.far_m.max(initial=0.0)) / geometry.resolution_m
    cells = nearest_on_rays(occupied, x, y, beam.headings_rad, reach)
    metres: NDArray[np.float64] = cells * geometry.resolution_m
    return metres


def _in_cells(beam: Beam, geometry: GridGeometry) -> tuple[float, float]:
    (x0, y0), start = geometry.origin_m, beam.world_from_sensor
    return (start.x_m - x0) / geometry.resolution_m, (start.y_m - y0) / geometry.resolution_m
