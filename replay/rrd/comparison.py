"""Several runs of one session → one recording that shows them side by side, in step.

Each run is drawn below its own root, just as it would be alone. What is shared stands above them:
one text on what each map made of the step, and the budget, so that the same readings are shown of
all.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from mapping.artifacts import Snapshot, Started
from mapping.config_text import commented_toml
from replay.comparison import Variant
from replay.comparison_steps import Distances, Moment, beams_of
from replay.rrd import columns, layout, scene
from replay.rrd.blueprints import comparison_blueprint
from replay.rrd.canvas import Canvas
from replay.rrd.comparison_explanation import Compared, describe_moment
from replay.rrd.run_drawer import OF_READINGS, RunDrawer
from replay.rrd.sink import RowBuffer, Sink, Stamp
from replay.rrd.thinning import Detail
from replay.rrd.writer import RrdWriter

_FEWEST_READINGS = 20  # between two looks at the file's size: each reading comes in every map
_SHARED = (layout.EXPLANATION, layout.MANUAL, layout.CONFIG, layout.NOTICE)


class ComparisonDrawer:
    """Draws what happens at each moment, in all runs that take part, as one step."""

    def __init__(self, variants: Sequence[Variant]) -> None:
        self._variants = {variant.name: variant for variant in variants}
        self._drawers: dict[str, RunDrawer] = {}
        self._begun: dict[str, Started] = {}
        self._finals: dict[str, list[Snapshot]] = {name: [] for name in self._variants}
        self._distances = Distances()
        self._readings = 0

    def blueprint(self, first: Moment) -> rrb.Blueprint:
        """The maps side by side. Raises TypeError for a moment that is not the start of all."""
        return comparison_blueprint(_starts(first))

    def last_blueprint(self) -> rrb.Blueprint | None:
        """The first one holds."""
        return None

    def begin(self, sink: Sink, first: Moment) -> None:
        """Lay out the empty maps, each below its own root."""
        self._begun = _starts(first)
        self._distances.take(first)
        one = next(iter(self._begun.values()))
        self.canvas = Canvas(sink, one.geometry, Stamp(0, 0, self.span_t_ns[0]))
        for name, started in self._begun.items():
            # The ranges are the same in all maps.
            without = (*_SHARED, layout.RANGES) if self._drawers else _SHARED
            self._drawers[name] = RunDrawer(explain=False)
            root = layout.root_of(name)
            self._drawers[name].begin(Sink(sink.recording, root, without), started)
        sink.log(layout.MAPS, rr.AnyValues(names=list(self._variants)))
        configs = (f"# {v.name}\n\n{commented_toml(v.config)}" for v in self._variants.values())
        scene.set_up_texts(sink, "\n\n".join(configs))
        self._explain(first, "")

    def draw(self, moment: Moment, detail: Detail) -> None:
        """Draw the next step: in each run its artifact."""
        self._distances.take(moment)
        beams, stamp = beams_of(moment), self.canvas.stamp
        reading, t_ns = stamp.reading, stamp.t_ns
        if beams:
            reading, t_ns = self._readings, beams[0].t_ns
            self._readings += 1
        self.canvas.stamp = stamp = Stamp(stamp.step + 1, reading, t_ns)
        for name, drawer in self._drawers.items():
            if name in moment:
                drawer.draw_at(stamp, moment[name], detail)
            elif beams and detail.shown:
                drawer.clear_at(stamp)
        for name, artifact in moment.items():
            if isinstance(artifact, Snapshot) and artifact.final:
                self._finals[name].append(artifact)
        of_reading = (isinstance(a, OF_READINGS) for a in moment.values())
        if detail.shown or not any(of_reading):
            self._explain(moment, detail.left_out)

    @staticmethod
    def begins_reading(moment: Moment) -> bool:
        """Whether what comes before a moment is complete."""
        return bool(beams_of(moment))

    @property
    def span_t_ns(self) -> tuple[int, int]:
        """When the first and the last reading of all runs were taken."""
        starts = self._begun.values()
        return min(one.first_t_ns for one in starts), max(one.last_t_ns for one in starts)

    @property
    def buffers(self) -> tuple[RowBuffer, ...]:
        """The rows of all maps that wait to be sent."""
        each = (rows for drawer in self._drawers.values() for rows in drawer.buffers)
        return (*each, self.canvas.rows)

    def reserved_bytes(self) -> int:
        """What the ends of all maps will add, however little is shown."""
        return sum(drawer.reserved_bytes() for drawer in self._drawers.values())

    def _explain(self, moment: Moment, left_out: str) -> None:
        known = Compared(self._variants, self._begun, self._finals, self._distances, left_out)
        text = describe_moment(moment, known)
        self.canvas.add(layout.EXPLANATION, columns.texts, text, len(text))


def _starts(moment: Moment) -> dict[str, Started]:
    started = {name: a for name, a in moment.items() if isinstance(a, Started)}
    if not started:
        raise TypeError("the first moment is the start of all runs")
    return started


def comparison_writer(
    path: str | os.PathLike[str],
    variants: Sequence[Variant],
    *,
    name: str,
    every: int = 1,
    budget_mb: float = 100.0,
    flush_readings: int = 1600,
) -> RrdWriter[Moment]:
    """A writer to be called with each moment of several runs; the budget is of the whole file."""
    return RrdWriter(
        path, ComparisonDrawer(variants), name=name, every=every, budget_mb=budget_mb,
        flush_readings=max(flush_readings // max(len(variants), 1), _FEWEST_READINGS),
    )  # fmt: skip
