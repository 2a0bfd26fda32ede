"""One session mapped with several configurations at once, into one recording and many folders."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mapping.artifacts import Artifact
from mapping.pipeline import build_maps
from mapping.placed_session import place_session
from mapping.selection import selected
from recorder.errors import BadInput
from recorder.messages import Range, Scan
from recorder.names import printable
from recorder.outputs import check_output
from recorder.session import Session, read_session
from recorder.truth import true_walls
from replay.collector import Collector
from replay.comparison import Variant
from replay.comparison_steps import Distances, Moment, beams_of, in_step
from replay.exports import Exporter, exporter_for
from replay.mapping_run import RunResult, result_of, with_progress
from replay.trajectory import TrackPoses

if TYPE_CHECKING:
    from replay.rrd.writer import RrdWriter


@dataclass(frozen=True, slots=True)
class Comparison:
    """What the runs came to, by name, and how far apart they have the robot."""

    results: dict[str, RunResult]
    distances: Distances


def compare_session(
    path: Path,
    variants: Sequence[Variant],
    *,
    more: Sequence[Path] = (),
    rrd: Path | None,
    export: Path | None,
    force: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Map a session (and ``more`` of it) with each variant, in step.

    All maps go into one recording; each one's files into a folder of its name below ``export``.
    ``progress(reading, readings)`` is called now and then. Raises an EchogridError in one line.
    """
    if rrd is not None:
        check_output(rrd, (path, *more), force=force)
    session = read_session(path, *more)
    runs = {each.name: _begun(session, each) for each in variants}
    collectors = {each.name: Collector() for each in variants}
    distances = Distances()
    with ExitStack() as stack:
        exporters = _exporters(variants, export, force=force)
        writer = _writer(variants, rrd, printable(path.name))
        if writer is not None:
            stack.enter_context(writer)
        order, _ = selected(session.records, variants[0].config)
        moments = in_step(runs, order)
        total = sum(isinstance(record.message, Range | Scan) for record in session.records)
        for moment in with_progress(moments, lambda m: bool(beams_of(m)), progress, total):
            if writer is not None:
                writer(moment)
            for name, artifact in moment.items():
                if exporters:
                    exporters[name](artifact)
                collectors[name](artifact)
            distances.take(moment)
    for variant in variants if exporters else ():
        placed = place_session(session.records, variant.config)
        exporters[variant.name].close(TrackPoses(placed), placed)
    left_out = "" if writer is None else writer.left_out
    results = {
        name: result_of(collector, session.damage, left_out, notes=session.notes)
        for name, collector in collectors.items()
    }
    return Comparison(results, distances)


def _begun(session: Session, variant: Variant) -> Iterator[Artifact]:
    """A run that has made its first artifact: one that cannot be mapped leaves no file behind."""
    run = _named(variant, session)
    return itertools.chain([next(run)], run)


def _named(variant: Variant, session: Session) -> Iterator[Artifact]:
    """A run whose troubles bear its name."""
    try:
        yield from build_maps(
            session.records, variant.config, walls_m=true_walls(session.attachments)
        )
    except BadInput as error:
        raise BadInput(f"{variant.name}: {error}") from None


def _exporters(
    variants: Sequence[Variant], export: Path | None, *, force: bool
) -> dict[str, Exporter]:
    if export is None:
        return {}
    return {
        each.name: exporter_for(export / each.name, each.config, force=force) for each in variants
    }


def _writer(variants: Sequence[Variant], rrd: Path | None, name: str) -> RrdWriter[Moment] | None:
    if rrd is None:
        return None
    from replay.rrd.comparison import comparison_writer

    return comparison_writer(
        rrd, variants, name=name,
        every=max(each.config.rerun.every for each in variants),
        budget_mb=_budget_mb(variants),
    )  # fmt: skip


def _budget_mb(variants: Sequence[Variant]) -> float:
    """What the file may take: as much as was asked for, or for each map its usual share."""
    sections = [each.config.rerun for each in variants]
    asked = [each.budget_mb for each in sections if "budget_mb" in each.model_fields_set]
    return min(asked) if asked else sum(each.budget_mb for each in sections)
