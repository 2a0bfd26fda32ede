"""Several runs of one session → one recording that shows them side by side, in step.

Each run is drawn below its own root, just as it would be alone. What is shared stands above them:
one text that tells what each map made of the step, and the budget, so that the same readings are
shown of all.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import rerun as rr
import rerun.blueprint as rrb

from mapping.artifacts import Artifact, MergedGrid, Snapshot, Started, TempGrid
from mapping.beams import Beam
from mapping.config_text import commented_toml
from replay.comparison import Variant
from replay.comparison_steps import Distances, Moment, beams_of
from replay.rrd import columns, layout, scene
from replay.rrd.canvas import Canvas
from replay.rrd.columns import ColumnBuffer, Stamp
from replay.rrd.comparison_blueprint import comparison_blueprint
from replay.rrd.comparison_words import Told, describe_moment
from replay.rrd.prefixed_stream import PrefixedStream, root_of
from replay.rrd.thinning import Thinning
from replay.rrd.words import LEGEND
from replay.rrd.writer import RrdWriter

_FEWEST_READINGS = 20  # between two looks at the file's size: each reading comes in every map
_SAID_ONCE = (layout.EXPLANATION, layout.LEGEND, layout.CONFIG, layout.NOTICE)


class ComparisonWriter(RrdWriter):
    """Write a recording of several runs: hand :meth:`take` each moment of them.

    Arguments and errors are those of :class:`RrdWriter`; the budget is that of the whole file.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        variants: Sequence[Variant],
        *,
        name: str,
        every: int = 1,
        budget_mb: float = 100.0,
        flush_readings: int = 1600,
    ) -> None:
        text = "\n\n".join(f"# {v.name}\n\n{commented_toml(v.config)}" for v in variants)
        super().__init__(
            path, config_text=text, name=name, every=every, budget_mb=budget_mb,
            flush_readings=max(flush_readings // max(len(variants), 1), _FEWEST_READINGS),
        )  # fmt: skip
        self._variants = {variant.name: variant for variant in variants}
        self._runs: dict[str, _Run] = {}
        self._begun: dict[str, Started] = {}
        self._finals: dict[str, list[Snapshot]] = {variant.name: [] for variant in variants}
        self._distances = Distances()
        self._readings = 0

    def take(self, moment: Moment) -> None:
        """Show what happens at one moment, in all runs that take part, as the next step."""
        self._distances.take(moment)
        started = {name: a for name, a in moment.items() if isinstance(a, Started)}
        if started:
            self._begin(started)
        elif not self._runs:
            raise TypeError("the first moment is the start of all runs")
        else:
            self._advance(moment)

    def _begin(self, started: Mapping[str, Started]) -> None:
        together = Started(
            next(iter(started.values())).geometry,
            tuple(dict.fromkeys(layer for one in started.values() for layer in one.layers)),
            next(iter(started.values())).walls_m,
            min(one.first_t_ns for one in started.values()),
            max(one.last_t_ns for one in started.values()),
        )
        self._started, self._begun = together, dict(started)
        recording = self._open(together)
        self._recording = recording
        self._canvas = Canvas(
            recording, together.geometry, ColumnBuffer(recording),
            layout.tiling_for(together.geometry), Stamp(0, 0, together.first_t_ns),
        )  # fmt: skip
        for name, one in started.items():
            without = _SAID_ONCE if not self._runs else (*_SAID_ONCE, layout.RANGES)
            stream = PrefixedStream(recording, root_of(name), without=without)
            self._runs[name] = _Run(self, name, stream, self.thinning)
            self._runs[name](one)
        names = rr.AnyValues(names=list(self._variants))
        recording.log(layout.MAPS, names, static=True, strict=True)
        scene.set_up_story(recording, layout.EXPLANATION)
        for entity, text, kind in (
            (layout.LEGEND, LEGEND, "text/markdown"),
            (layout.CONFIG, self._config_text, "text/plain"),
        ):
            recording.log(entity, rr.TextDocument(text, media_type=kind), static=True, strict=True)
        self._tell(dict(started))
        self._flush()

    def _advance(self, moment: Moment) -> None:
        beams = beams_of(moment)
        stamp = self._canvas.stamp
        stamp = Stamp(stamp.step + 1, stamp.reading, stamp.t_ns)
        if beams:
            self._review()
            self._shown = self.thinning.next_is_shown()
            stamp = Stamp(stamp.step, self._readings, beams[0].t_ns)
            self._readings += 1
        self._canvas.stamp = stamp
        for name, run in self._runs.items():
            if name in moment:
                run.show(moment[name], stamp, shown=self._shown)
            elif beams and self._shown:
                run.rest(stamp)
        for name, artifact in moment.items():
            if isinstance(artifact, Snapshot) and artifact.final:
                self._finals[name].append(artifact)
        results = not any(_of_a_reading(artifact) for artifact in moment.values())
        if self._shown or results:
            self._tell(moment)

    def _tell(self, moment: Moment) -> None:
        told = Told(
            self._variants, self._begun, self._finals, self._distances, self.thinning.left_out
        )
        text = describe_moment(moment, told)
        self._canvas.add(layout.EXPLANATION, columns.texts, text, len(text))

    def _blueprint(self, started: Started) -> rrb.Blueprint:
        return comparison_blueprint(self._begun)

    def _buffers(self) -> Sequence[ColumnBuffer]:
        return (*(rows for run in self._runs.values() for rows in run.buffers), self._canvas.rows)

    def _reserved_bytes(self) -> int:
        return sum(run.reserved_bytes for run in self._runs.values())


class _Run(RrdWriter):
    """One of the runs, drawn as it would be alone; its file and its budget are the comparison's."""

    def __init__(
        self, whole: ComparisonWriter, name: str, stream: PrefixedStream, thinning: Thinning
    ) -> None:
        super().__init__(whole.path, config_text="", name=name)
        self.thinning = thinning
        self._stream = stream

    def show(self, artifact: Artifact, stamp: Stamp, *, shown: bool) -> None:
        """Draw an artifact at the step of all runs."""
        self._canvas.stamp, self._shown = stamp, shown
        self._show(artifact)

    def rest(self, stamp: Stamp) -> None:
        """Another run uses a reading that this one leaves out: take the last one's traces away."""
        self._canvas.stamp = stamp
        self._canvas.wipe()

    @property
    def buffers(self) -> Sequence[ColumnBuffer]:
        """The rows that wait."""
        return self._buffers()

    @property
    def reserved_bytes(self) -> int:
        """What the end of this run will take in the file."""
        return self._reserved_bytes()

    def _open(self, started: Started) -> rr.RecordingStream:
        return self._stream

    def _explain(self, artifact: Artifact) -> None:
        self._record_step(artifact)

    def _flush(self) -> None:
        """The comparison does it for all."""


def _of_a_reading(artifact: Artifact) -> bool:
    return isinstance(artifact, Beam | TempGrid | MergedGrid)
