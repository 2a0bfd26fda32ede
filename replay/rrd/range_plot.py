"""The ranges of a whole run over its seconds, with what became of each reading, as one picture.

The viewer's own plots run along the timeline that one steps by, and that counts steps. This one
runs in seconds from the first reading, shows readings that were dropped, which are no step, and has
its legend beside it. A line marks the reading that the maps show. It is drawn once, at the end.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from mapping.artifacts import Artifact, DroppedReadings, Finished, Started
from mapping.beams import Beam
from recorder.clock import NS_PER_S
from replay.colours import in_place, pale
from replay.rrd import columns, layout
from replay.rrd.axes import nice_step, ticks
from replay.rrd.canvas import Canvas
from replay.rrd.layout import Colour
from replay.rrd.legend import BACKGROUND
from replay.rrd.prediction import PredictionOverlay
from replay.rrd.sink import Sink

Floats = NDArray[np.float64]

# On the paper: the plot is WIDTH by HEIGHT, y down; below it a lane for each sensor.
WIDTH, HEIGHT = 4.0, 1.5
_LANE, _LANE_GAP, _LEFT, _RIGHT, _ABOVE, _NUMBERS = 0.09, 0.15, 0.35, 1.3, 0.12, 0.28
_TICK = 0.03
_BINS = 600  # of a lane: finer than the screen
_INK, _TEXT, _PALE_INK = (150, 155, 165, 255), (225, 228, 235, 255), (60, 64, 72, 255)
_CURSOR = (255, 255, 255, 255)
_NO_DOT = -0.1

ECHO, NOTHING, TOO_CLOSE, NO_POSE, DROPPED = range(5)
STATES = ("echo", "nothing seen", "too close", "no pose", "dropped")
_STATE_COLOURS: dict[int, Colour] = {
    NOTHING: (125, 130, 140, 255), TOO_CLOSE: (240, 210, 60, 255), NO_POSE: (214, 39, 40, 255),
    DROPPED: layout.REJECTED,
}  # fmt: skip
_OF_REASON = {
    "saw nothing (skipped)": NOTHING, "too close": TOO_CLOSE, "zero or negative": TOO_CLOSE,
    "below the sensor's minimum": TOO_CLOSE, "no pose at that time": NO_POSE,
    "no head angle at that time": NO_POSE,
}  # fmt: skip


@dataclass(slots=True)
class _Curve:
    """The readings of one sensor: seconds, measured and predicted metres (NaN: none)."""

    seconds: list[float] = field(default_factory=list)
    measured_m: list[float] = field(default_factory=list)
    predicted_m: list[float] = field(default_factory=list)


class RangePlotOverlay:
    """Follows a run beside the overlay that predicts its ranges, and draws it at the end."""

    def __init__(self, prediction: PredictionOverlay, *, most_points: int) -> None:
        self._prediction, self._most = prediction, most_points
        self._curves: dict[str, _Curve] = {}
        self._errors: dict[str, float] = {}
        self._span_ns = (0, 1)

    def start(self, canvas: Canvas, started: Started) -> None:
        """Know when the run begins and ends, and how well each sensor measures."""
        self._span_ns = started.first_t_ns, max(started.last_t_ns, started.first_t_ns + 1)
        self._errors = {sensor.name: sensor.range_error for sensor in started.sensors}
        look = rr.LineStrips2D.from_fields(
            colors=[_CURSOR], radii=[-0.7], draw_order=layout.ORDER_PROBE
        )
        canvas.sink.log(layout.PLOT_CURSOR, look)

    def draw(self, canvas: Canvas, artifact: Artifact, *, shown: bool) -> str:
        """Note one reading and move the line to it; at the end draw all."""
        if isinstance(artifact, Beam):
            seconds = self._seconds(artifact.t_ns)
            curve = self._curves.setdefault(artifact.sensor, _Curve())
            nearest = float(artifact.ranges_m[artifact.saw_something].min(initial=np.inf))
            curve.seconds.append(seconds)
            curve.measured_m.append(nearest if np.isfinite(nearest) else np.nan)
            curve.predicted_m.append(self._prediction.newest_m if shown else np.nan)
            if shown:
                x = WIDTH * seconds / self._last_s
                line = np.array([[x, -_ABOVE / 2], [x, self._bottom]])
                canvas.add(layout.PLOT_CURSOR, columns.strips, [line])
        elif isinstance(artifact, Finished) and self._curves:
            paper = _Paper(self._last_s, _largest(self._curves.values()), canvas.sink)
            names = in_place(self._curves)
            for name in names:
                self._draw_curve(paper, name, canvas.colour(name))
            states = self._states(names, artifact.dropped_at)
            paper.draw_axes()
            paper.draw_lanes({name: (states[name], canvas.colour(name)) for name in names})
            scans = {name for name in names if self._prediction.scans(name)}
            paper.draw_legend([(name, canvas.colour(name), name in scans) for name in names])
        return ""

    @property
    def _last_s(self) -> float:
        return (self._span_ns[1] - self._span_ns[0]) / NS_PER_S

    @property
    def _bottom(self) -> float:
        return HEIGHT + _NUMBERS + _LANE_GAP * max(len(self._errors), 1)

    def _seconds(self, t_ns: int) -> float:
        return (t_ns - self._span_ns[0]) / NS_PER_S

    def _draw_curve(self, paper: _Paper, name: str, colour: Colour) -> None:
        curve = self._curves[name]
        every = -(-len(curve.seconds) // self._most)
        seconds, measured_m, predicted_m = (
            np.array(each[::every]) for each in (curve.seconds, curve.measured_m, curve.predicted_m)
        )
        root = f"{layout.PLOT}/{layout.part(name)}"
        faint = layout.opaque(pale(colour[:3], 0.45))
        paper.draw_line(f"{root}/predicted", seconds, predicted_m, faint)
        paper.draw_spread(f"{root}/spread", seconds, measured_m, self._errors.get(name, 0), colour)
        paper.draw_dots(f"{root}/measured", seconds, measured_m, colour)

    def _states(
        self, names: Sequence[str], dropped_at: Iterable[DroppedReadings]
    ) -> dict[str, NDArray[np.int64]]:
        """The state of each sensor in each of the bins of its lane; -1: no reading."""
        counts = {name: np.zeros((_BINS, len(STATES)), np.int64) for name in names}

        def add(name: str, seconds: Floats, state: NDArray[np.int64]) -> None:
            bins = np.clip((seconds / self._last_s * _BINS).astype(np.int64), 0, _BINS - 1)
            np.add.at(counts[name], (bins, state), 1)

        for name in names:
            nothing = np.isnan(self._curves[name].measured_m)
            seconds = np.array(self._curves[name].seconds)
            add(name, seconds, np.where(nothing, NOTHING, ECHO))
        for each in dropped_at:
            if each.sensor in counts:
                seconds = (each.t_ns - self._span_ns[0]) / NS_PER_S
                inside = (seconds >= 0) & (seconds <= self._last_s)
                state = _OF_REASON.get(each.reason, DROPPED)
                add(each.sensor, seconds[inside], np.full(int(inside.sum()), state))
        return {name: _filled(count) for name, count in counts.items()}


def range_plot_view(started: Started, name: str) -> rrb.Spatial2DView:
    """The view that it fills."""
    lanes = max(len(started.sensors), 1)
    return rrb.Spatial2DView(
        origin=layout.PLOT, name=name, background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-_LEFT, WIDTH + _RIGHT],
            y_range=[-_ABOVE, HEIGHT + _NUMBERS + _LANE_GAP * lanes + 0.25],
        ),
    )  # fmt: skip


def _filled(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """The commonest state of each bin, (bins,); it lasts until about the next reading is due."""
    any_read = counts.any(axis=1)
    lasts = max(-(-2 * _BINS // max(int(counts.sum()), 1)), 1)
    newest = np.maximum.accumulate(np.where(any_read, np.arange(_BINS), -_BINS))
    known = np.arange(_BINS) - newest <= lasts
    return np.where(known, counts.argmax(axis=1)[np.maximum(newest, 0)], -1)


def _largest(curves: Iterable[_Curve]) -> float:
    measured = [np.nanmax(c.measured_m) for c in curves if not np.isnan(c.measured_m).all()]
    return float(max(measured, default=1.0)) or 1.0


@dataclass(frozen=True, slots=True)
class _Paper:
    """Seconds and metres → places on the paper, and what is drawn there, for good."""

    last_s: float
    largest_m: float
    sink: Sink

    def at(self, seconds: Floats, metres: Floats) -> Floats:
        """Places, (N, 2)."""
        inside = np.minimum(metres, self.largest_m)
        return np.column_stack(
            [WIDTH * seconds / self.last_s, HEIGHT * (1.0 - inside / self.largest_m)]
        )

    def draw_dots(self, entity: str, seconds: Floats, metres: Floats, colour: Colour) -> None:
        there = np.isfinite(metres)
        dots = self.at(seconds[there], metres[there])
        look = rr.Points2D(dots, colors=[colour], radii=[-1.0], draw_order=layout.ORDER_POINTS)
        self.sink.log(entity, look)

    def draw_line(self, entity: str, seconds: Floats, metres: Floats, colour: Colour) -> None:
        """A line with gaps where there is no number."""
        there = np.isfinite(metres)
        cuts = np.flatnonzero(np.diff(there.astype(np.int8)) != 0) + 1
        parts = np.split(np.arange(len(metres)), cuts)
        strips = [self.at(seconds[p], metres[p]) for p in parts if len(p) > 1 and there[p[0]]]
        self._lines(entity, strips, [colour], [-0.6], layout.ORDER_PATH)

    def draw_spread(
        self, entity: str, seconds: Floats, metres: Floats, error: float, colour: Colour
    ) -> None:
        """How far the obstacle may be from what was measured: an upright stroke each."""
        there = np.isfinite(metres)
        s, m = seconds[there], metres[there]
        ends = np.stack([self.at(s, m * (1 - error)), self.at(s, m * (1 + error))], axis=1)
        r, g, b = (round(0.4 * value + 0.6 * 21) for value in colour[:3])
        self._lines(entity, list(ends), [(r, g, b, 255)], [-0.8], layout.ORDER_WALLS)

    def draw_axes(self) -> None:
        strips = [np.array([[0.0, 0.0], [0.0, HEIGHT], [WIDTH, HEIGHT]])]
        grid, places, labels = [], [], []
        for m in ticks(0.0, self.largest_m, nice_step(self.largest_m / 4)):
            (place,) = self.at(np.zeros(1), np.array([m]))
            grid.append(np.array([place, place + np.array([WIDTH, 0.0])]))
            places.append(place - np.array([0.16, 0.09]))
            labels.append(f"{m:g} m")
        every = nice_step(self.last_s / 7)
        for s in ticks(0.0, self.last_s, every):
            (place,) = self.at(np.array([s]), np.zeros(1))
            strips.append(np.array([place, place + np.array([0.0, _TICK])]))
            places.append(place + np.array([0.0, _TICK]))
            labels.append(f"{s:g} s")
        self._lines(f"{layout.PLOT}/grid", grid, [_PALE_INK], [-0.5], layout.ORDER_TILES)
        self._lines(f"{layout.PLOT}/axes", strips, [_INK], [-0.6], layout.ORDER_AXES)
        self._labels(f"{layout.PLOT}/numbers", places, labels)

    def draw_lanes(self, lanes: Mapping[str, tuple[NDArray[np.int64], Colour]]) -> None:
        """A row of coloured stretches for each sensor, and what the colours mean."""
        strips: list[Floats] = []
        looks: list[Colour] = []
        for number, (states, colour) in enumerate(lanes.values()):
            y = HEIGHT + _NUMBERS + _LANE_GAP * number + _LANE / 2
            cuts = np.flatnonzero(np.diff(states)) + 1
            for part in np.split(np.arange(_BINS), cuts):
                state = int(states[part[0]])
                if state >= 0:
                    x = WIDTH * np.array([part[0], part[-1] + 1]) / _BINS
                    strips.append(np.column_stack([x, np.full(2, y)]))
                    looks.append(colour if state == ECHO else _STATE_COLOURS[state])
        y = HEIGHT + _NUMBERS + _LANE_GAP * len(lanes) + _LANE / 2
        places, labels = [], []
        present = {int(s) for states, _ in lanes.values() for s in np.unique(states)}
        shown = [state for state in _STATE_COLOURS if state in present]
        for number, state in enumerate(shown):
            middle = np.array([WIDTH * (number + 0.5) / max(len(shown), 3), y])
            half = np.array([0.15, 0.0])
            strips.append(np.stack([middle - half, middle + half]))
            looks.append(_STATE_COLOURS[state])
            places.append(middle)
            labels.append(STATES[state])
        entity = f"{layout.PLOT}/lanes"
        self._lines(entity, strips, looks, [_LANE / 2], layout.ORDER_WALLS)
        self._labels(f"{entity}/names", places, labels)

    def draw_legend(self, sensors: Sequence[tuple[str, Colour, bool]]) -> None:
        """Right of the plot: each sensor's colour; of a scan the nearest of its ranges is drawn."""
        strips, looks, places, labels = [], [], [], []
        x0, x1 = WIDTH + 0.3, WIDTH + _RIGHT - 0.25
        for number, (name, colour, scans) in enumerate(sensors):
            height = 0.06 + 0.33 * number
            strips.append(np.array([[x0, height], [x1, height]]))
            looks.append(colour)
            places.append(np.array([(x0 + x1) / 2, height]))
            labels.append(f"{name}, nearest" if scans else name)
        y = 0.06 + 0.33 * len(sensors)
        strips.append(np.array([[x0, y], [x1, y]]))
        looks.append(layout.opaque(pale(sensors[0][1][:3], 0.45)))
        places.append(np.array([(x0 + x1) / 2, y]))
        labels.append("pale: predicted")
        entity = f"{layout.PLOT}/legend"
        self._lines(entity, strips, looks, [0.02], layout.ORDER_AXES)
        self._labels(f"{entity}/names", places, labels)

    def _lines(
        self, entity: str, strips: Sequence[Floats], looks: Sequence[Colour],
        radii: Sequence[float], order: float,
    ) -> None:  # fmt: skip
        style = rr.LineStrips2D(list(strips), colors=list(looks), radii=radii, draw_order=order)
        self.sink.log(entity, style)

    def _labels(self, entity: str, places: Sequence[Floats], labels: Sequence[str]) -> None:
        look = rr.Points2D(
            np.array(places).reshape(-1, 2), labels=labels, show_labels=True, radii=[_NO_DOT],
            colors=[_TEXT], draw_order=layout.ORDER_AXES,
        )  # fmt: skip
        self.sink.log(entity, look)
