"""Mapping with several configurations at once, and what is said of it afterwards."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from recorder.cli.progress import progress_bar
from replay.cli.map_report import tell_damage, tell_files

if TYPE_CHECKING:
    from replay.comparison import Variant
    from replay.comparison_run import Comparison

_WIDEST = 160  # columns of text; a file or a pipe gets 80


def compare_and_report(
    session: Path, variants: Sequence[Variant], rrd: Path | None, export: Path | None, *,
    more: Sequence[Path] = (), force: bool, quiet: bool,
) -> int:  # fmt: skip
    from replay.comparison_run import compare_session

    with progress_bar(f"mapping {session.name}, {len(variants)} times", quiet=quiet) as advance:
        comparison = compare_session(
            session, variants, more=more, rrd=rrd, export=export, force=force,
            progress=advance,
        )  # fmt: skip
    of_all = next(iter(comparison.results.values()))  # what is lost and left out is so in each
    status = tell_damage(session, of_all.damage)
    if not quiet:
        _tell(variants, comparison)
        tell_files(of_all.left_out, rrd, export)
    return status


def _tell(variants: Sequence[Variant], comparison: Comparison) -> None:
    from replay.comparison_table import (
        comparison_lines,
        footnotes,
        same_maps,
        shown_layer,
        table_of,
    )
    from replay.terminal import legend, pictures_beside, summary_lines, table_lines

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
    click.echo(pictures_beside(shown, min(shutil.get_terminal_size().columns, _WIDEST)))
    click.echo(f"{legend(layer)}\n")
    lines = comparison_lines(snapshots, layer, thresholds)
    for line in table_lines(table_of(lines)):
        click.echo(line)
    segments = {name: result.segments for name, result in results.items()}
    for note in (*footnotes(lines), *same_maps(snapshots, segments, thresholds)):
        click.echo(note)
    for each in variants:
        if each.note:
            click.echo(f"{each.name}: {each.note}")
    for told in comparison.distances.told():
        click.echo(told)
    _tell_readings({name: summary_lines(result.finished) for name, result in results.items()})


def _tell_readings(told: Mapping[str, list[str]]) -> None:
    """How many readings each map used; once, where it is the same for all."""
    alike = len({tuple(lines) for lines in told.values()}) == 1
    for name, lines in told.items():
        for line in lines:
            click.echo(line if alike else f"{name}: {line}")
        if alike:
            return
