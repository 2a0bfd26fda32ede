"""The range that the map so far predicts, beside the one that was measured."""

from __future__ import annotations

import numpy as np
import rerun as rr

from mapping.artifacts import Artifact, Started
from mapping.beams import Beam
from mapping.prediction import RangePredictor
from replay.rrd import columns, layout
from replay.rrd.canvas import Canvas
from replay.rrd.layout import Colour
from replay.rrd.sink import Sink

_ALMOST_M = 0.05  # measured and predicted ranges this close are called the same
_ALMOST_SHARE = 0.1  # of the range


class PredictionOverlay:
    """Plots the nearest predicted range of each reading; cells above ``threshold`` stop a beam."""

    def __init__(self, threshold: float) -> None:
        self._threshold = threshold
        self.predictor = RangePredictor(threshold)
        self.newest_m = np.nan  # of the newest reading; NaN where nothing is predicted
        self._scans: set[str] = set()

    def start(self, canvas: Canvas, started: Started) -> None:
        """Know the grid."""
        self.predictor(started)

    def draw(self, canvas: Canvas, artifact: Artifact, *, shown: bool) -> str:
        """A point of the plot at each beam, and how well the map knew it, as text."""
        if not isinstance(artifact, Beam):
            self.predictor(artifact)
            return ""
        self.newest_m = np.nan
        if len(artifact.ranges_m) > 1:
            self._scans.add(artifact.sensor)
        if not shown:
            return ""
        predicted = float(self.predictor.ranges_m(artifact).min(initial=np.inf))
        measured = float(artifact.ranges_m[artifact.saw_something].min(initial=np.inf))
        entity = layout.predicted_range(artifact.sensor)
        colour = canvas.colour(artifact.sensor)
        nearest = ", nearest" if self.scans(artifact.sensor) else ""
        canvas.prepare(entity, _set_up, f"{artifact.sensor}{nearest}, predicted", colour)
        # Where the map predicts nothing the plot has a gap; the number itself is inf.
        self.newest_m = predicted if np.isfinite(predicted) else np.nan
        canvas.add(entity, columns.scalars, self.newest_m)
        canvas.add(entity, columns.number_records, np.array([predicted]))
        return _explained(measured, predicted, self._threshold)

    def scans(self, sensor: str) -> bool:
        """Whether a sensor takes many ranges at once, of which the nearest is plotted."""
        return sensor in self._scans


def _explained(measured_m: float, predicted_m: float, threshold: float) -> str:
    """Whether the map so far knew what was measured."""
    if np.isinf(predicted_m):
        knew = f"no cell of the beam is above {100 * threshold:g} %"
        ending = ": the obstacle is new to it." if np.isfinite(measured_m) else ", as measured."
        return f"**The map so far** would have predicted **nothing**: {knew}{ending}"
    predicted = f"**The map so far** would have predicted **{predicted_m:.3f} m**"
    if np.isinf(measured_m):
        return f"{predicted}: what stood there is not seen now."
    gap = predicted_m - measured_m
    if abs(gap) <= max(_ALMOST_M, _ALMOST_SHARE * measured_m):
        return f"{predicted}: it knew this obstacle."
    return f"{predicted}, {abs(gap):.3f} m {'more' if gap > 0 else 'less'} than was measured."


def _set_up(sink: Sink, entity: str, name: str, colour: Colour) -> None:
    """The measured range's colour, paler, and crosses instead of dots."""
    r, g, b, _ = colour
    pale = ((r + 255) // 2, (g + 255) // 2, (b + 255) // 2, 255)
    points = rr.SeriesPoints(names=[name], colors=[pale], marker_sizes=[3], markers="cross")
    sink.log(entity, points)
    lines = rr.SeriesLines(names=[name], colors=[pale], widths=[1.0])
    sink.log(entity, lines)
