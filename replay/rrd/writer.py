"""A run, or several compared → a recording in a file, within a budget.

A drawer makes the steps; this keeps the file. It is written beside its target and renamed at the
end, so there is never half a recording; what a killed process leaves beside it can still be read.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar

import rerun as rr
import rerun.blueprint as rrb

from mapping.artifacts import Artifact
from mapping.config import MappingConfig
from mapping.probing import CellProbe
from recorder.errors import BadInput
from recorder.outputs import Beside, check_room
from replay.rrd import columns, layout
from replay.rrd.canvas import Canvas
from replay.rrd.run_drawer import configured_drawer
from replay.rrd.sink import RowBuffer, Sink, new_recording
from replay.rrd.thinning import Detail, Thinning

_BUFFER_BYTES = 96_000_000  # rows wait in memory up to this size
_DISK_MARGIN_BYTES = 1_000_000
_FLUSH_S = 120.0  # far longer than any disk takes
_FIRST_REVIEW = 50  # readings

Item = TypeVar("Item", contravariant=True)


class Drawer(Protocol[Item]):
    """What a writer asks of whoever draws: of one run's artifacts, or the moments of several."""

    def blueprint(self, first: Item) -> rrb.Blueprint:
        """How the viewer is laid out. Raises TypeError where nothing begins so."""

    def last_blueprint(self) -> rrb.Blueprint | None:
        """How the viewer is laid out when all is known, where that is another way."""

    def begin(self, sink: Sink, first: Item) -> None:
        """Lay out the empty map."""

    def draw(self, item: Item, detail: Detail) -> None:
        """Draw the next step."""

    def begins_reading(self, item: Item) -> bool:
        """Whether what comes before is complete."""

    @property
    def canvas(self) -> Canvas:
        """Where the steps are drawn; of several maps, what is shared."""

    @property
    def span_t_ns(self) -> tuple[int, int]:
        """When the first and the last reading were taken."""

    @property
    def buffers(self) -> Sequence[RowBuffer]:
        """The rows that wait to be sent."""

    def reserved_bytes(self) -> int:
        """What the end will add, however little is shown."""


class RrdWriter(Generic[Item]):
    """Write a recording to ``path``: call it with each artifact (or moment), the start first.

    ``every`` shows only every k-th reading; ``budget_mb`` leaves more out when the file would pass
    that size (``left_out`` then describes what, and so does the recording). ``flush_readings``
    is how many readings may be lost when the process is killed. Raises TypeError for something
    that is no artifact, BadInput when the file cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        drawer: Drawer[Item],
        *,
        name: str,
        every: int = 1,
        budget_mb: float = 100.0,
        flush_readings: int = 1600,
    ) -> None:
        self.path = Path(path)
        self._beside: Beside | None = None
        self.thinning = Thinning(budget_mb * 1e6, every)
        self._drawer, self._name = drawer, name
        self._flush_readings, self._unflushed = flush_readings, 0
        self._recording: rr.RecordingStream | None = None
        self._detail = Detail()
        self._size_then = self._exact_then = 0
        self._over = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        elif self._recording is not None:
            self._recording.disconnect()
            self._recording = None
        if self._beside is not None:
            self._beside.discard()

    @property
    def part(self) -> Path:
        """Where it is written until it is complete; once it has begun."""
        assert self._beside is not None
        return self._beside.part

    def __call__(self, item: Item) -> None:
        """Show one artifact as the next step."""
        if self._recording is None:
            self._recording = self._open(self._drawer.blueprint(item))
            self._drawer.begin(Sink(self._recording), item)
            self._flush()  # what never changes is in the file from now on, whatever happens
            return
        if self._drawer.begins_reading(item):
            self._review()
            self._detail = self.thinning.next()
        self._drawer.draw(item, self._detail)

    @property
    def left_out(self) -> str:
        """A sentence on what was left out to keep to the budget; empty when nothing was.

        After :meth:`close` also when the budget was too small for what is always written.
        """
        return f"{self.thinning.left_out}{self._over}"

    @property
    def waiting_bytes(self) -> int:
        """What waits in memory, roughly."""
        return sum(rows.bytes for rows in self._drawer.buffers)

    def close(self) -> None:
        """Write what waits, end the file properly and give it its name."""
        if self._recording is None or self._beside is None:
            return
        self._flush()
        last = self._drawer.last_blueprint()
        if last is not None:
            self._recording.send_blueprint(last, make_active=False, make_default=True)
        self._recording.disconnect()
        self._recording = None
        size = self.part.stat().st_size
        if size > self.thinning.budget_bytes:
            self._over = f" Even so it takes {size / 1e6:.1f} MB."
        self._beside.finish()

    def _open(self, blueprint: rrb.Blueprint) -> rr.RecordingStream:
        recording = new_recording()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            check_room(self.path, _DISK_MARGIN_BYTES)
            self._beside = Beside(self.path)
            recording.save(self.part, default_blueprint=blueprint)
        except (OSError, RuntimeError) as error:
            raise BadInput(f"{self.path}: cannot be written: {error}") from None
        recording.send_recording_name(self._name)
        return recording

    def _review(self) -> None:
        """From time to time: write what waits, and see whether the file stays in its budget."""
        drawer = self._drawer
        self._unflushed += 1
        # More often at first, so that a costly session is noticed before much is written.
        stamp = drawer.canvas.stamp
        patience = min(self._flush_readings, max(_FIRST_REVIEW, stamp.reading // 2))
        if self._unflushed <= patience and self.waiting_bytes < _BUFFER_BYTES:
            return
        self._flush()
        first, last = drawer.span_t_ns
        done = (stamp.t_ns - first) / (last - first) if last > first else 0.0
        size = self.part.stat().st_size
        exact = sum(rows.exact_bytes for rows in drawer.buffers)
        share = (exact - self._exact_then) / max(size - self._size_then, 1)
        self._size_then, self._exact_then = size, exact
        notice = self.thinning.review(size, done, drawer.reserved_bytes(), share)
        if notice:
            drawer.canvas.add(layout.NOTICE, columns.notices, notice, len(notice))

    def _flush(self) -> None:
        """Hand everything to the file and wait until it is written.

        The room on the disk is looked at first: Rerun's writer reports to nobody when it fails.
        """
        assert self._recording is not None
        self._unflushed = 0
        check_room(self.part, self.waiting_bytes + _DISK_MARGIN_BYTES)
        for rows in self._drawer.buffers:
            rows.send()
        try:
            self._recording.flush(timeout_sec=_FLUSH_S)
        except (RuntimeError, OSError, TimeoutError) as error:
            raise BadInput(f"{self.path}: cannot be written: {error}") from None


def run_writer(
    path: Path, config: MappingConfig, *, name: str, probes: Sequence[CellProbe] = ()
) -> RrdWriter[Artifact]:
    """The writer of a mapping run with all that its configuration asks to be shown."""
    return RrdWriter(
        path, configured_drawer(config, probes), name=name, every=config.rerun.every,
        budget_mb=config.rerun.budget_mb,
    )  # fmt: skip
