"""Artifacts → a recording that shows them one by one.

Each artifact is one step. The file is written beside its target and renamed at the end, so there
is never half a recording; what a killed process leaves beside it can still be read.
"""

from __future__ import annotations

import os
import uuid
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import rerun as rr
import rerun.blueprint as rrb

from mapping.artifacts import (
    Artifact,
    Border,
    Classes,
    Finished,
    LineStage,
    MergedGrid,
    RawPoints,
    Segment,
    Snapshot,
    Started,
    TempGrid,
    Thresholded,
    TracerStep,
)
from mapping.beams import Beam
from recorder.errors import BadInput
from recorder.outputs import check_room
from replay.rrd import columns, layout, readings, scene, stages, words
from replay.rrd.blueprints import default_blueprint
from replay.rrd.canvas import Canvas
from replay.rrd.columns import ColumnBuffer, Stamp
from replay.rrd.overlays import Overlay
from replay.rrd.results import Results
from replay.rrd.thinning import Thinning

APPLICATION = "echogrid"
_BUFFER_BYTES = 96_000_000  # rows wait in memory up to this size
_DISK_MARGIN_BYTES = 1_000_000
_FLUSH_S = 120.0  # far longer than any disk takes
_INDEX_COST = 1600  # bytes of the file's own index at its end for each chunk, roughly
_CHUNK_COST = 1200  # bytes of a chunk without what it holds
_PICTURES_SHARE = 0.15  # of a map's values, for what is drawn of it at the end
_END_COST = 100_000  # bytes of what else comes at the end
_FIRST_REVIEW = 50  # readings


class RrdWriter:
    """Write a recording to ``path``: call it with each artifact, :class:`Started` first.

    ``every`` shows only every k-th reading; ``budget_mb`` leaves more out when the file would pass
    that size (``left_out`` then says what, and so does the recording). ``flush_readings``
    is how many readings may be lost when the process is killed. Raises TypeError for something
    that is no artifact, BadInput when the file cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        config_text: str,
        name: str,
        every: int = 1,
        budget_mb: float = 100.0,
        flush_readings: int = 1600,
        overlays: Sequence[Overlay] = (),
    ) -> None:
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        self.thinning = Thinning(budget_mb * 1e6, every)
        self._config_text, self._name = config_text, name
        self._flush_readings, self._unflushed = flush_readings, 0
        self._overlays, self._asides = tuple(overlays), ""
        self._recording: rr.RecordingStream | None = None
        self._shown = True
        self._size_then = self._exact_then = 0
        self._over = ""

    def __enter__(self) -> RrdWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self._drop()

    def __call__(self, artifact: Artifact) -> None:
        """Show one artifact as the next step."""
        if isinstance(artifact, Started):
            self._start(artifact)
        elif self._recording is None:
            raise TypeError(f"the first artifact is Started, not {type(artifact).__name__}")
        else:
            self._step(artifact)

    @property
    def left_out(self) -> str:
        """What was left out to keep to the budget, in words; empty when nothing was.

        After :meth:`close` it also tells when the budget was too small for what is always written.
        """
        return f"{self.thinning.left_out}{self._over}"

    def close(self) -> None:
        """Write what waits, end the file properly and give it its name."""
        if self._recording is None:
            return
        self._flush()
        self._recording.disconnect()
        self._recording = None
        size = self.part.stat().st_size
        if size > self.thinning.budget_bytes:
            self._over = f" Even so it takes {size / 1e6:.1f} MB."
        os.replace(self.part, self.path)

    def _start(self, started: Started) -> None:
        """Lay out the empty map, with every layer unseen."""
        recording = self._open(started)
        self._recording = recording
        self._started = started
        self._canvas = Canvas(
            recording, started.geometry, columns.ColumnBuffer(recording),
            layout.tiling_for(started.geometry), Stamp(0, 0, started.first_t_ns),
        )  # fmt: skip
        self._results = Results(self._canvas)
        scene.set_up(recording, started, self._config_text)
        for name in started.layers:
            self._canvas.layer(name)
            self._canvas.draw_layer(name, exact=False)
        for overlay in self._overlays:
            overlay.start(self._canvas, started)
        self._explain(started)
        self._flush()  # what never changes is in the file from now on, whatever happens

    def _open(self, started: Started) -> rr.RecordingStream:
        """The file's stream, with its blueprint."""
        recording = rr.RecordingStream(APPLICATION, recording_id=str(uuid.uuid4()))
        recording.set_log_time_enabled(False)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            check_room(self.part, _DISK_MARGIN_BYTES)
            recording.save(self.part, default_blueprint=self._blueprint(started))
        except (OSError, RuntimeError) as error:
            raise BadInput(f"{self.path}: cannot be written: {error}") from None
        recording.send_recording_name(self._name)
        return recording

    def _blueprint(self, started: Started) -> rrb.Blueprint:
        return default_blueprint(started)

    def _buffers(self) -> Sequence[ColumnBuffer]:
        """All rows that wait for the file."""
        return (self._canvas.rows,)

    def _step(self, artifact: Artifact) -> None:
        stamp = self._canvas.stamp
        if isinstance(artifact, Beam):
            self._review()
            self._shown = self.thinning.next_is_shown()
            stamp = Stamp(stamp.step, artifact.number, artifact.t_ns)
        self._canvas.stamp = Stamp(stamp.step + 1, stamp.reading, stamp.t_ns)
        self._show(artifact)

    def _show(self, artifact: Artifact) -> None:
        """Draw an artifact at the canvas's step."""
        self._draw_overlays(artifact)
        match artifact:
            case Beam() | TempGrid() | MergedGrid():
                self._take_reading(artifact)
            case (
                Snapshot() | Thresholded() | Classes() | Border() | TracerStep() | RawPoints()
                | LineStage() | Segment()
            ):  # fmt: skip
                self._canvas.wipe()
                self._draw_result(artifact)
                self._explain(artifact)
            case Finished():
                self._explain(artifact)
            case _:
                raise TypeError(f"{type(artifact).__name__} is no artifact")

    def _draw_overlays(self, artifact: Artifact) -> None:
        shown = self._shown or not isinstance(artifact, Beam | TempGrid | MergedGrid)
        said = [each.draw(self._canvas, artifact, shown=shown) for each in self._overlays]
        self._asides = "".join(f"\n\n{text}" for text in said if text)

    def _take_reading(self, artifact: Beam | TempGrid | MergedGrid) -> None:
        """A reading that is not shown still changes the map, which the next shown one draws."""
        canvas = self._canvas
        match artifact:
            case Beam():
                canvas.layer(artifact.layer)
                if self._shown:
                    readings.draw_beam(canvas, artifact)
            case TempGrid():
                touched = artifact.band | artifact.free
                canvas.layer(artifact.beam.layer).see(artifact.window, touched)
                canvas.newest_temp = artifact
                if self._shown:
                    readings.draw_temp(canvas, artifact)
            case MergedGrid():
                if not self._shown:
                    canvas.merge(artifact, shown=False, exact=self.thinning.tells_all)
                else:
                    readings.draw_merged(canvas, artifact, exact=self.thinning.exact)
                    if self.thinning.changes:
                        readings.draw_change(canvas, artifact)
        if self._shown:
            self._explain(artifact)

    def _draw_result(
        self,
        artifact: Snapshot | Thresholded | Classes | Border | TracerStep | RawPoints | LineStage
        | Segment,
    ) -> None:  # fmt: skip
        match artifact:
            case Snapshot():
                self._results.draw_snapshot(artifact)
            case Thresholded():
                self._results.draw_thresholded(artifact)
            case Classes():
                self._results.draw_classes(artifact)
            case Border():
                self._results.draw_border(artifact)
                stages.draw_border_start(self._canvas, artifact)
            case RawPoints():
                self._results.draw_raw_points(artifact)
            case TracerStep():
                stages.draw_tracer_step(self._canvas, artifact)
            case LineStage():
                stages.draw_line_stage(self._canvas, artifact)
            case Segment():
                self._results.draw_segment(artifact)

    def _explain(self, artifact: Artifact) -> None:
        """Say what this step is: in words, and as a record for the reader."""
        text = words.describe(artifact) + self._asides
        if isinstance(artifact, Finished):
            text = f"{text}\n\n{self.thinning.left_out}"
        self._canvas.add(layout.EXPLANATION, columns.texts, text, len(text))
        self._record_step(artifact)

    def _record_step(self, artifact: Artifact) -> None:
        exact = self._canvas.exact_layers
        record = columns.StepRecord(type(artifact).__name__, words.layer_of(artifact), exact)
        self._canvas.add(layout.STEPS, columns.step_records, record)

    def _review(self) -> None:
        """From time to time: write what waits, and see whether the file stays in its budget."""
        self._unflushed += 1
        # More often at first, so that a costly session is noticed before much is written.
        patience = min(self._flush_readings, max(_FIRST_REVIEW, self._canvas.stamp.reading // 2))
        waiting = sum(rows.bytes for rows in self._buffers())
        if self._unflushed <= patience and waiting < _BUFFER_BYTES:
            return
        self._flush()
        first, last = self._started.first_t_ns, self._started.last_t_ns
        done = (self._canvas.stamp.t_ns - first) / (last - first) if last > first else 0.0
        size = self.part.stat().st_size
        exact = sum(rows.exact_bytes for rows in self._buffers())
        share = (exact - self._exact_then) / max(size - self._size_then, 1)
        self._size_then, self._exact_then = size, exact
        notice = self.thinning.review(size, done, self._reserved_bytes(), share)
        if notice:
            self._canvas.add(layout.NOTICE, columns.notices, notice, len(notice))

    def _reserved_bytes(self) -> int:
        """What the exact values of all layers will take at the end, and the file's own index."""
        layers = [state.packed_tiles() for state in self._canvas.layers.values()]
        counts, sizes = [tiles for tiles, _ in layers], [size for _, size in layers]
        # Fused, there is about one layer more. Each is written some 5 times: what never changes of
        # its tiles, values, picture, cells above the threshold, classes. All but the values are
        # bytes where these are floats, and pack better.
        tiles = sum(counts) + max(counts, default=0)
        values = sum(sizes) + max(sizes, default=0.0)
        chunks = _INDEX_COST * (self._canvas.chunks + 5 * tiles) + _CHUNK_COST * 5 * tiles
        return int((1.0 + _PICTURES_SHARE) * values) + chunks + _END_COST

    def _flush(self) -> None:
        """Hand everything to the file and wait until it is written.

        The room on the disk is looked at first: Rerun's writer, once it fails, says so to nobody.
        """
        if self._recording is None:
            return
        self._unflushed = 0
        waiting = sum(rows.bytes for rows in self._buffers())
        check_room(self.part, waiting + _DISK_MARGIN_BYTES)
        for rows in self._buffers():
            rows.send()
        try:
            self._recording.flush(timeout_sec=_FLUSH_S)
        except (RuntimeError, OSError, TimeoutError) as error:
            raise BadInput(f"{self.path}: cannot be written: {error}") from None

    def _drop(self) -> None:
        if self._recording is not None:
            self._recording.disconnect()
            self._recording = None
            self.part.unlink(missing_ok=True)
