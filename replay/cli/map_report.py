"""Mapping with a progress bar, once or with several configurations, and the report afterwards."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import click

from recorder.cli.progress import Advance, progress_bar

if TYPE_CHECKING:
    from mapping.config import MappingConfig
    from replay.comparison import Variant
    from replay.comparison_run import Comparison
    from replay.mapping_run import RunResult

_WIDEST = 160  # columns of text; a file or a pipe gets 80


def map_and_report(
    session: Path, config: MappingConfig, rrd: Path | None, export: Path | None, *, force: bool,
    quiet: bool, probes: Sequence[tuple[float, float]] = (), more: Sequence[Path] = (),
    bag: Path | None = None,
) -> int:  # fmt: skip
    from replay.mapping_run import map_session

    with (
        progress_bar(f"mapping {session.name}", quiet=quiet) as advance,
        first_run(advance, quiet=quiet),
    ):
        result = map_session(
            session, config, more=more, rrd=rrd, export=export, bag=bag, force=force,
            probes=probes, progress=advance,
        )  # fmt: skip
    status = _report_damage(session, result.damage)
    if not quiet:
        for note in result.notes:
            click.echo(f"echogrid: {session.name}: {note}", err=True)
        click.echo("\n".join(_map_report(result)))
        _report_unknown_sensors(config, result)
        _report_files(result.left_out, rrd, export, bag)
    return status


def compare_and_report(
    session: Path, variants: Sequence[Variant], rrd: Path | None, export: Path | None, *,
    more: Sequence[Path] = (), force: bool, quiet: bool,
) -> int:  # fmt: skip
    from replay.comparison_run import compare_session

    title = f"mapping {session.name}, {len(variants)} times"
    with progress_bar(title, quiet=quiet) as advance, first_run(advance, quiet=quiet):
        comparison = compare_session(
            session, variants, more=more, rrd=rrd, export=export, force=force,
            progress=advance,
        )  # fmt: skip
    of_all = next(iter(comparison.results.values()))  # what is lost and left out is so in each
    status = _report_damage(session, of_all.damage)
    if not quiet:
        for note in of_all.notes:
            click.echo(f"echogrid: {session.name}: {note}", err=True)
        click.echo("\n".join(_comparison_report(variants, comparison)))
        _report_files(of_all.left_out, rrd, export)
    return status


def first_run(advance: Advance, *, quiet: bool) -> AbstractContextManager[None]:
    """The bar names what is being compiled: only the first run on a machine waits for it."""
    if quiet or not sys.stderr.isatty():
        return nullcontext()
    from mapping.kernels.first_run import compiling_reported

    return compiling_reported(
        lambda name: advance(0, None, f"compiling {name} (only the first run)")
    )


def _report_files(left_out: str, *paths: Path | None) -> None:
    """What was written, and what of it was left out."""
    if left_out:
        click.echo(left_out)
    written = [str(path) for path in paths if path is not None]
    if written:
        click.echo("wrote " + " and ".join(written))


def _report_damage(session: Path, damage: Sequence[str]) -> int:
    """What of the session is lost; returns the exit code."""
    for reason in damage:
        click.echo(f"echogrid: {session}: {reason}", err=True)
    return 1 if damage else 0


def _report_unknown_sensors(config: MappingConfig, result: RunResult) -> None:
    """A sensor that the configuration names and the map lacks may be a misspelt one."""
    used = result.finished.used
    for name in config.sensors:
        if name != "*" and name not in used:
            click.echo(
                f"echogrid: sensors.{name} is configured, but the map has no reading of it "
                f"(it has {', '.join(used)})",
                err=True,
            )


def _map_report(result: RunResult) -> Iterator[str]:
    from replay.probe_text import explanation_lines
    from replay.terminal import map_lines

    maps = {snapshot.layer.name: snapshot.layer for snapshot in result.snapshots}
    shown = maps[result.clearest]
    yield from map_lines(shown, result.finished)
    walls = sum(s.source == "grid" and s.layer == shown.name for s in result.segments)
    yield f"{walls} line segments in layer {shown.name}"
    others = [name for name in maps if name != shown.name]
    if others:
        yield f"further layers: {', '.join(others)}"
    for probe in result.probes:
        yield from ("", *explanation_lines(probe, tuple(maps)))


def _comparison_report(variants: Sequence[Variant], comparison: Comparison) -> Iterator[str]:
    from replay.comparison_table import footnotes, map_rows, same_maps, shown_layer, table_of
    from replay.tables import text_table
    from replay.terminal import legend, pictures_beside, summary_lines

    results = comparison.results
    snapshots = {name: result.snapshots for name, result in results.items()}
    thresholds = {each.name: each.config.borders.threshold for each in variants}
    layer = shown_layer(snapshots)
    shown = {
        name: (snapshot.layer.probability, snapshot.layer.observed, thresholds[name])
        for name, some in snapshots.items()
        for snapshot in some
        if snapshot.layer.name == layer
    }
    yield pictures_beside(shown, min(shutil.get_terminal_size().columns, _WIDEST))
    yield f"{legend(layer)}\n"
    rows = map_rows(snapshots, layer, thresholds)
    yield from text_table(table_of(rows))
    yield from footnotes(rows)
    segments = {name: result.segments for name, result in results.items()}
    yield from same_maps(snapshots, segments, thresholds)
    yield from (f"{each.name}: {each.note}" for each in variants if each.note)
    yield from comparison.distances.sentences()
    summaries = {name: summary_lines(result.finished) for name, result in results.items()}
    first = next(iter(summaries.values()))
    if all(lines == first for lines in summaries.values()):
        yield from first
    else:
        yield from (f"{name}: {line}" for name, lines in summaries.items() for line in lines)
