"""One mapping run from a session file to everything that people get of it."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from mapping.artifacts import Artifact, Finished, Segment, Snapshot
from mapping.config import MappingConfig
from mapping.pipeline import build_maps
from mapping.placed_session import place_session
from mapping.probing import CellProbe
from recorder.errors import BadInput
from recorder.names import printable
from recorder.outputs import check_output
from recorder.session.columns import open_session
from recorder.truth import true_walls
from replay.collector import Collector
from replay.trajectory import TrackPoses

if TYPE_CHECKING:
    from replay.exports import Exporter
    from replay.rrd.writer import RrdWriter

Step = TypeVar("Step")
Taker = Callable[[Artifact], None]

_PROGRESS_EVERY = 50  # readings


@dataclass(frozen=True, slots=True)
class RunResult:
    """What a run came to: the final layers, the lines, the counts, and what was lost."""

    snapshots: tuple[Snapshot, ...]
    segments: tuple[Segment, ...]
    finished: Finished
    damage: tuple[str, ...]
    left_out: str
    probes: tuple[CellProbe, ...] = ()
    rrd: Path | None = None
    clearest: str = ""  # the layer to look at first
    notes: tuple[str, ...] = ()  # what was taken otherwise than it came, or assumed


def map_session(
    path: Path,
    config: MappingConfig,
    *,
    more: Sequence[Path] = (),
    rrd: Path | None,
    export: Path | None,
    bag: Path | None = None,
    probes: Sequence[tuple[float, float]] = (),
    force: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> RunResult:
    """Map a session into a recording, a directory of files and a ROS 2 bag, where asked for.

    ``more`` are further parts of the session, or further sessions of the same robot and place.
    ``probes`` are points of the map (metres) whose cells are followed.
    ``progress(reading, readings)`` is called now and then. Raises an EchogridError in one line.
    """
    if rrd is not None:
        check_output(rrd, (path, *more), force=force)
    if bag is not None:
        check_output(bag, (path, *more), force=force)
    session = open_session(path, *more)
    try:
        placed = place_session(session, config)
        counts = placed.counts
    except BadInput as error:
        raise BadInput("; ".join([str(error), *session.damage[:1]])) from None
    total, count = counts.readings, _every_now_and_then(progress, counts.readings)
    artifacts = build_maps(
        placed, config, walls_m=true_walls(session.attachments), merged=count,
        watched=rrd is not None or bool(probes), threads=idle_cores(),
    )  # fmt: skip
    first = next(artifacts)  # a session that cannot be mapped leaves no file behind
    followed = tuple(CellProbe(at_m) for at_m in probes)
    for probe in followed:
        probe(first)  # nor does a cell outside the grid
    collector = Collector()
    takers: list[Taker] = [*followed, collector]  # before the writer, which draws their cells
    exporter = None if export is None else _exporter(export, config, force=force)
    if exporter is not None:
        takers.append(exporter)
    with ExitStack() as stack:
        writer = None
        if rrd is not None:
            writer = stack.enter_context(_writer(rrd, config, printable(path.name), followed))
            takers.append(writer)
        for artifact in itertools.chain([first], artifacts):
            for take in takers:
                take(artifact)
    if progress is not None:
        progress(total, total)  # those that were dropped came to no beam
    poses = TrackPoses(placed)
    if exporter is not None:
        exporter.close(poses, placed)
    if bag is not None:
        from replay.occupancy_bag import write_bag

        layers = [snapshot.layer for snapshot in collector.snapshots.values()]
        write_bag(bag, layers, poses, force=force)
    from mapping.diagnosis.first_sight import worst_line

    left_out = "" if writer is None else writer.left_out
    notes = (*session.notes, *filter(None, [worst_line(placed, config)]))
    return result_of(collector, session.damage, left_out, probes=followed, rrd=rrd, notes=notes)


def cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def idle_cores() -> int:
    """How many of them nobody else keeps busy, one at least: threads that wait for each other are
    slower than one where other programs take turns with them."""
    busy = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    return max(round(cores() - busy), 1)


def _every_now_and_then(
    progress: Callable[[int, int], None] | None, total: int
) -> Callable[[int], None] | None:
    if progress is None:
        return None

    shown = 0

    def count(merged: int) -> None:
        nonlocal shown
        if merged - shown >= _PROGRESS_EVERY:
            shown = merged
            progress(merged, total)

    return count


def _exporter(directory: Path, config: MappingConfig, *, force: bool) -> Exporter:
    from replay.exports import exporter_for

    return exporter_for(directory, config, force=force)


def _writer(
    rrd: Path, config: MappingConfig, name: str, probes: Sequence[CellProbe]
) -> RrdWriter[Artifact]:
    from replay.rrd.writer import run_writer

    return run_writer(rrd, config, name=name, probes=probes)


def with_progress(
    steps: Iterable[Step],
    begins_reading: Callable[[Step], bool],
    progress: Callable[[int, int], None] | None,
    total: int,
) -> Iterator[Step]:
    """The steps of a run, while ``progress`` is called with how many readings have gone by."""
    readings = 0
    for step in steps:
        yield step
        if progress is not None and begins_reading(step):
            readings += 1
            if readings % _PROGRESS_EVERY == 0:
                progress(readings, total)
    if progress is not None:
        progress(total, total)  # those that were dropped came to no beam


def result_of(
    collector: Collector,
    damage: tuple[str, ...],
    left_out: str,
    *,
    probes: tuple[CellProbe, ...] = (),
    rrd: Path | None = None,
    notes: tuple[str, ...] = (),
) -> RunResult:
    """What a run came to, once it is finished."""
    assert collector.finished is not None, "the last artifact of a run is Finished"
    return RunResult(
        tuple(collector.snapshots.values()), tuple(collector.segments), collector.finished,
        damage, left_out, probes, rrd, collector.clearest, (*notes, *collector.finished.notes),
    )  # fmt: skip
