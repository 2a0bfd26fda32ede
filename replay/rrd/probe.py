"""How a watched cell looks: marked on the map, its belief as a plot, its readings as a list."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mapping.artifacts import Artifact, Finished, MergedGrid, Snapshot, Started
from mapping.probing import BEHIND, CellProbe, Touch
from replay import probe_text
from replay.rrd import columns, layout, scene
from replay.rrd.canvas import Canvas
from replay.rrd.sink import Sink, Stamp

_CHANGED = 0.01  # of probability: what is less is not to be seen in the plot
_HAIR_SHARE = 0.03  # of the grid's diagonal: the four strokes that point at the cell


class ProbeOverlay:
    """Draws some probes; each must have taken an artifact before it is offered here."""

    def __init__(self, probes: Sequence[CellProbe]) -> None:
        self._probes = tuple(probes)
        self._listed = [0] * len(self._probes)
        self._layers: tuple[str, ...] = ()
        self._first = Stamp(0, 0, 0)
        self._plotted: set[str] = set()
        self._changed: dict[int, tuple[int, int]] = {}

    @property
    def changed_steps(self) -> list[tuple[int, int] | None]:
        """Of each probe the first and the last step so far that changed its cell."""
        return [self._changed.get(number) for number in range(len(self._probes))]

    def start(self, canvas: Canvas, started: Started) -> None:
        """A mark on the map for each cell, and its story before the first reading."""
        self._layers, self._first = started.layers, canvas.stamp
        for number, probe in enumerate(self._probes):
            _mark(canvas, number, probe)
            self._write(canvas, number, probe)

    def draw(self, canvas: Canvas, artifact: Artifact, *, shown: bool) -> str:
        """Plot the belief, list the reading if it reached the cell; what it did, as text."""
        if not isinstance(artifact, MergedGrid | Snapshot | Finished):
            return ""
        texts = (self._follow(canvas, artifact, n, shown) for n in range(len(self._probes)))
        return "\n\n".join(filter(None, texts))

    def _follow(
        self, canvas: Canvas, artifact: MergedGrid | Snapshot | Finished, number: int, shown: bool
    ) -> str:
        probe = self._probes[number]
        new = probe.touches[self._listed[number] :]
        self._listed[number] = len(probe.touches)
        for touch in new:
            line = probe_text.touch_text(touch)
            canvas.add(
                layout.probe_log(number), columns.log_lines, (line, _level(touch)), len(line)
            )
        if not isinstance(artifact, Finished):
            layer = artifact.layer if isinstance(artifact, MergedGrid) else artifact.layer.name
            self._plot(canvas, number, probe, layer, new)
        if any(abs(touch.effect) > _CHANGED for touch in new):
            step = canvas.stamp.step
            self._changed[number] = self._changed.get(number, (step, step))[0], step
        if isinstance(artifact, Finished) or (shown and any(touch.effect for touch in new)):
            self._write(canvas, number, probe)
        if not new:
            return ""
        line = probe_text.touch_text(new[-1])
        return f"**Your cell at {probe_text.name_of(probe)}**: {line}."

    def _plot(
        self, canvas: Canvas, number: int, probe: CellProbe, layer: str, new: Sequence[Touch]
    ) -> None:
        """The layer's belief in the cell, per cent; from the first step on once it is known."""
        if layer not in probe.beliefs:
            return
        entity = layout.probe_belief(number, layer)
        canvas.prepare(entity, _set_up_belief, layer, canvas.colour(layer))
        if entity not in self._plotted and new:
            canvas.rows.add(entity, columns.scalars, self._first, 100 * new[0].before)
        self._plotted.add(entity)
        canvas.add(entity, columns.scalars, 100 * probe.beliefs[layer])

    def _write(self, canvas: Canvas, number: int, probe: CellProbe) -> None:
        text = probe_text.explanation(probe, self._layers)
        canvas.add(layout.probe_story(number), columns.texts, text, len(text))


def _level(touch: Touch) -> str:
    """Readings that leave the cell as it is are written paler."""
    return "DEBUG" if touch.zone == BEHIND else "INFO"


def _mark(canvas: Canvas, number: int, probe: CellProbe) -> None:
    """The cell's own square, and four strokes that end short of it."""
    geometry = canvas.geometry
    centre, half = np.array(probe.centre_m), geometry.resolution_m / 2
    corners = [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]
    near = 2.5 * half
    far = near + _HAIR_SHARE * math.hypot(*geometry.size_m)
    ways: NDArray[np.float64] = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]], np.float64)
    strips = [centre + half * np.array(corners), *(centre + np.array([near * w, far * w])
                                                   for w in ways)]  # fmt: skip
    mark = rr.LineStrips2D(
        strips, colors=[layout.PROBE], radii=[-1.5], draw_order=layout.ORDER_PROBE
    )
    canvas.sink.log(layout.probe_mark(number), mark)
    scene.set_up_markdown(canvas.sink, layout.probe_story(number))


def _set_up_belief(sink: Sink, entity: str, name: str, colour: layout.Colour) -> None:
    """A stair: a belief stays until the next reading that reaches the cell."""
    lines = rr.SeriesLines(
        names=[f"{name}, % occupied"], colors=[colour], widths=[2.0], interpolation_mode="StepAfter"
    )
    sink.log(entity, lines)
