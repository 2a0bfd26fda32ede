"""What a reading would have been, had the map so far been the room.

Compared with what was measured it shows whether the map already knows the place: the two agree
where it does, and part where a wall is new, or where a reading is wrong.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Artifact, MergedGrid, Started
from mapping.beams import Beam
from mapping.grid import GridGeometry


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
        from mapping.kernels.loops import nearest_in_cone, nearest_on_rays

        occupied, resolution = self._occupied[beam.layer], geometry.resolution_m
        x = (beam.world_from_sensor.x_m - geometry.origin_m[0]) / resolution
        y = (beam.world_from_sensor.y_m - geometry.origin_m[1]) / resolution
        beyond = abs(x) + abs(y) + geometry.rows + geometry.cols  # no cell is further away
        reach = min(float(np.max(beam.reach_m)) / resolution, beyond)
        if len(beam.ranges_m) == 1:
            half = beam.beam_width_rad / 2.0
            heading = float(beam.headings_rad[0])
            cells = np.array([nearest_in_cone(occupied, x, y, heading, half, reach)])
        else:
            cells = nearest_on_rays(occupied, x, y, beam.headings_rad, reach)
        metres: NDArray[np.float64] = cells * resolution
        return metres

    def _layer(self, name: str, geometry: GridGeometry) -> NDArray[np.bool_]:
        if name not in self._occupied:
            self._occupied[name] = np.zeros(geometry.shape, np.bool_)
        return self._occupied[name]
