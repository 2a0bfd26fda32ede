"""The artifacts of one run → its steps: each is drawn, described, and listed for the reader."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Protocol

import rerun.blueprint as rrb

from mapping.artifacts import Artifact, Finished, MergedGrid, RejectedReading, Started, TempGrid
from mapping.beams import Beam
from mapping.config import MappingConfig
from mapping.config_text import commented_toml
from mapping.probing import CellProbe
from replay.colours import sensor_colours
from replay.probe_text import name_of
from replay.rrd import columns, layout, properties, readings, scene
from replay.rrd.blueprints import Watched, default_blueprint
from replay.rrd.canvas import Canvas
from replay.rrd.display_layers import DisplayOverlay
from replay.rrd.explanation import described, layer_of
from replay.rrd.layers import Layers
from replay.rrd.legend import LegendOverlay
from replay.rrd.outcome import OutcomeOverlay
from replay.rrd.prediction import PredictionOverlay
from replay.rrd.probe import ProbeOverlay
from replay.rrd.range_plot import RangePlotOverlay
from replay.rrd.results import Results
from replay.rrd.sink import RowBuffer, Sink, Stamp
from replay.rrd.steps import StepList
from replay.rrd.thinning import Detail
from replay.rrd.thresholds import ThresholdsOverlay

OF_READINGS = Beam | TempGrid | MergedGrid | RejectedReading
_PLOTTED_A_MB = 60  # points of a sensor in the plot of ranges, for each megabyte that there is


class Overlay(Protocol):
    """Something that follows a run and draws on its canvas: a watched cell, a predicted range.

    It is offered each artifact before the artifact itself is drawn, so it sees the map as it was.
    """

    def start(self, canvas: Canvas, started: Started) -> None:
        """Draw what never changes; called once, when the empty map is laid out."""

    def draw(self, canvas: Canvas, artifact: Artifact, *, shown: bool) -> str:
        """Follow one artifact, and draw if the step is ``shown``; markdown for its explanation."""


class RunDrawer:
    """Draws one run into one sink: :meth:`begin` with its start, then :meth:`draw` the others.

    One that is not to ``explain`` leaves the text of each step to whoever compares several runs.
    """

    def __init__(
        self,
        config_text: str = "",
        *,
        overlays: Sequence[Overlay] = (),
        blueprint: Callable[[Started], rrb.Blueprint] = default_blueprint,
        last_blueprint: Callable[[Started], rrb.Blueprint] | None = None,
        explain: bool = True,
    ) -> None:
        self._last_blueprint = last_blueprint
        self._config_text, self._overlays, self._explain = config_text, tuple(overlays), explain
        self._blueprint = blueprint

    def blueprint(self, first: Artifact) -> rrb.Blueprint:
        """How the viewer is laid out. Raises TypeError where a run does not begin so."""
        if not isinstance(first, Started):
            raise TypeError(f"the first artifact is Started, not {type(first).__name__}")
        return self._blueprint(first)

    def last_blueprint(self) -> rrb.Blueprint | None:
        """How the viewer is laid out when all is known, where that is another way."""
        return None if self._last_blueprint is None else self._last_blueprint(self._started)

    def begin(self, sink: Sink, first: Artifact) -> None:
        """Lay out the empty map, with every layer unseen."""
        assert isinstance(first, Started)
        self._started = first
        layer_of = {sensor.name: sensor.layer for sensor in first.sensors}
        found = sensor_colours(first.layers, layer_of)
        colours = {name: layout.opaque(colour) for name, colour in found.items()}
        self.canvas = Canvas(sink, first.geometry, Stamp(0, 0, first.first_t_ns), colours)
        self._steps = StepList(self.canvas.rows)
        self._layers = Layers(self.canvas, first.layers)
        self._results = Results(self.canvas, self._layers)
        scene.set_up(sink, first, self._config_text)
        properties.note_start(sink, first, self._config_text)
        for name in first.layers:
            self._layers.set_up(name)
        for overlay in self._overlays:
            overlay.start(self.canvas, first)
        self._record(first)

    def draw(self, artifact: Artifact, detail: Detail) -> None:
        """Draw an artifact as the next step."""
        step, stamp = self.canvas.stamp.step + 1, self.canvas.stamp
        if isinstance(artifact, Beam):
            stamp = Stamp(step, artifact.number, artifact.t_ns)
        elif isinstance(artifact, RejectedReading):
            stamp = Stamp(step, artifact.beam.number, artifact.beam.t_ns)
        self.draw_at(Stamp(step, stamp.reading, stamp.t_ns), artifact, detail)

    def draw_at(self, stamp: Stamp, artifact: Artifact, detail: Detail) -> None:
        """Draw an artifact at a step; of a reading that is not shown the map still takes all."""
        canvas, layers = self.canvas, self._layers
        canvas.stamp = stamp
        shown = detail.shown or not isinstance(artifact, OF_READINGS)
        texts = [each.draw(canvas, artifact, shown=shown) for each in self._overlays]
        match artifact:
            case Beam():
                self._results.clear()
                layers.set_up(artifact.layer)
                if shown:
                    readings.draw_beam(canvas, artifact)
            case TempGrid():
                layers.see(artifact)
                if shown:
                    readings.draw_temp(canvas, artifact)
            case MergedGrid():
                if shown:
                    canvas.wipe(layout.temp(artifact.layer))
                layers.merge(artifact, shown=shown, exact=detail.exact)
                if shown and detail.changes:
                    readings.draw_change(canvas, artifact)
            case RejectedReading():
                self._results.clear()
                layers.set_up(artifact.beam.layer)
                if shown:
                    readings.draw_rejected(canvas, artifact)
            case Finished():
                self._results.finish(readings.draw_end(canvas))
                texts.append(detail.left_out)
                properties.note_end(canvas.sink, artifact)
            case _:
                canvas.wipe()
                self._results.draw(artifact)
        if shown:
            self._record(artifact, texts)

    def clear_at(self, stamp: Stamp) -> None:
        """Take the traces of the newest reading away: the run leaves out the one of this step."""
        self.canvas.stamp = stamp
        self.canvas.wipe()

    @staticmethod
    def begins_reading(artifact: Artifact) -> bool:
        """Whether what comes before an artifact is complete."""
        return isinstance(artifact, Beam)

    @property
    def span_t_ns(self) -> tuple[int, int]:
        """When the run's first and last reading were taken."""
        return self._started.first_t_ns, self._started.last_t_ns

    @property
    def buffers(self) -> tuple[RowBuffer, ...]:
        """The rows that wait to be sent."""
        return (self.canvas.rows,)

    def reserved_bytes(self) -> int:
        """What the end of the run will add, however little is shown."""
        return self._layers.reserved_bytes()

    def _record(self, artifact: Artifact, more: Sequence[str] = ()) -> None:
        """Describe the step in markdown, and list it for the reader."""
        if self._explain:
            text = described(artifact, [*filter(None, more)])
            self.canvas.add(layout.EXPLANATION, columns.texts, text, len(text))
        kind, stamp = type(artifact).__name__, self.canvas.stamp
        self._steps.add(stamp, kind, layer_of(artifact), self._layers.exact)


def configured_drawer(config: MappingConfig, probes: Sequence[CellProbe] = ()) -> RunDrawer:
    """The drawer of a run with all that its configuration asks to be shown.

    Each probe must take an artifact before the drawer does.
    """
    section, borders = config.rerun, config.borders
    prediction = PredictionOverlay(borders.threshold)
    overlays: list[Overlay] = [
        prediction, OutcomeOverlay(prediction.predictor, config.borders.threshold), LegendOverlay(),
        RangePlotOverlay(prediction, most_points=max(round(_PLOTTED_A_MB * section.budget_mb), 20)),
    ]  # fmt: skip
    if section.display:
        overlays.append(
            DisplayOverlay(
                section.display, levels=section.display_levels, budget_mb=section.budget_mb
            )
        )
    if borders.compare:
        overlays.append(ThresholdsOverlay(borders))
    watching = ProbeOverlay(probes)
    if probes:
        overlays.append(watching)

    def blueprint(started: Started) -> rrb.Blueprint:
        watched = [
            Watched(name_of(probe), probe.at_m, steps)
            for probe, steps in zip(probes, watching.changed_steps, strict=True)
        ]
        return default_blueprint(
            started, displays=section.display, thresholds=borders.compare, probes=watched
        )

    return RunDrawer(
        commented_toml(config), overlays=overlays, blueprint=blueprint,
        last_blueprint=blueprint if probes else None,
    )  # fmt: skip


def live_drawer(config: MappingConfig) -> RunDrawer:
    """The drawer of a run that goes on: in the colours and places of a finished one, at its end.

    What looks at a run as a whole, or at maps in several ways, is left to the recording.
    """
    prediction = PredictionOverlay(config.borders.threshold)
    overlays: list[Overlay] = [
        prediction,
        OutcomeOverlay(prediction.predictor, config.borders.threshold),
        LegendOverlay(),
    ]
    blueprint = functools.partial(default_blueprint, following=True)
    return RunDrawer(commented_toml(config), overlays=overlays, blueprint=blueprint)
