"""One mapping run from a session file to everything that people get of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Artifact, Finished, Segment, Snapshot
from mapping.config import MappingConfig
from mapping.config_text import commented_toml
from mapping.pipeline import build_maps
from mapping.probing import CellProbe
from recorder.messages import Range, Scan
from recorder.outputs import check_output
from recorder.session import WALLS, Session, read_session
from replay.exports import Exporter


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


def map_session(
    path: Path,
    config: MappingConfig,
    *,
    more: Sequence[Path] = (),
    rrd: Path | None,
    export: Path | None,
    probes: Sequence[tuple[float, float]] = (),
    force: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> RunResult:
    """Map a session into a recording and a directory of files, each where it is asked for.

    ``more`` are further parts of the session, or further sessions of the same robot and place.
    ``probes`` are points of the map (metres) whose cells are followed.
    ``progress(reading, readings)`` is called now and then. Raises an EchogridError in one line.
    """
    if rrd is not None:
        check_output(rrd, (path, *more), force=force)
    session = read_session(path, *more)
    text = commented_toml(config)
    artifacts = build_maps(session.messages(), config, walls_m=true_walls(session))
    watched = tuple(CellProbe(at_m) for at_m in probes)
    takers: list[Callable[[Artifact], None]] = [*watched]  # before the writer, which draws them
    with ExitStack() as stack:
        exporter = None
        first = next(artifacts)  # a session that cannot be mapped leaves no file behind
        for probe in watched:
            probe(first)  # nor does a cell outside the grid
        if export is not None:
            exporter = Exporter(
                export, config_text=text, config=config.model_dump(mode="json"), force=force
            )
            takers.append(exporter)
        writer = None
        if rrd is not None:
            from replay.rrd.run_writer import RunWriter

            writer = stack.enter_context(
                RunWriter(rrd, config, config_text=text, name=path.name, probes=watched)
            )
            takers.append(writer)
        kept = _run(first, artifacts, takers, progress, reading_count(session))
    if exporter is not None:
        exporter.close()
    snapshots = tuple(a for a in kept if isinstance(a, Snapshot))
    segments = tuple(a for a in kept if isinstance(a, Segment))
    finished = next(a for a in kept if isinstance(a, Finished))
    left_out = "" if writer is None else writer.left_out
    return RunResult(snapshots, segments, finished, session.damage, left_out, watched, rrd)


def _run(
    first: Artifact,
    others: Iterator[Artifact],
    takers: Sequence[Callable[[Artifact], None]],
    progress: Callable[[int, int], None] | None,
    total: int,
) -> list[Artifact]:
    from mapping.beams import Beam

    kept: list[Artifact] = []
    artifact: Artifact | None = first
    while artifact is not None:
        for take in takers:
            take(artifact)
        if isinstance(artifact, Snapshot):  # lines of an earlier stage are no results
            kept = [each for each in kept if not isinstance(each, Segment)]
        if isinstance(artifact, Segment | Finished) or (
            isinstance(artifact, Snapshot) and artifact.final
        ):
            kept.append(artifact)
        if progress is not None and isinstance(artifact, Beam) and artifact.number % 50 == 0:
            progress(artifact.number, total)
        artifact = next(others, None)
    if progress is not None:
        progress(total, total)  # those that were dropped came to no beam
    return kept


def reading_count(session: Session) -> int:
    """How many readings there are to map: what a progress bar counts to."""
    return sum(isinstance(record.message, Range | Scan) for record in session.records)


def true_walls(session: Session) -> NDArray[np.float64] | None:
    """The true walls of a simulated room, where the session carries them."""
    if WALLS not in session.attachments:
        return None
    from recorder.simulator.room_files import walls_from_geojson

    return walls_from_geojson(session.attachments[WALLS])
