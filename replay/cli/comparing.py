"""Mapping with several configurations at once, and what is said of it afterwards."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from replay.comparison import Variant
    from replay.comparison_run import Comparison

_WIDEST = 160  # columns of text; a file or a pipe gets 80


def compare_and_tell(
    session: Path, variants: Sequence[Variant], rrd: Path | None, export: Path | None, *,
    more: Sequence[Path] = (), force: bool, quiet: bool,
) -> int:  # fmt: skip
    from rich.console import Console
    from rich.progress import Progress

    from replay.comparison_run import compare_session

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task(f"mapping {session.name}, {len(variants)} times", total=None)
        comparison = compare_session(
            session, variants, more=more, rrd=rrd, export=export, force=force,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )  # fmt: skip
    damage = next(iter(comparison.results.values())).damage
    for reason in damage:
        click.echo(f"echogrid: {session}: {reason}", err=True)
    if not quiet:
        _tell(variants, comparison, rrd, export)
    return 1 if damage else 0


def _tell(
    variants: Sequence[Variant], comparison: Comparison, rrd: Path | None, export: Path | None
) -> None:  # fmt: skip
    from replay.comparison_table import (
        comparison_lines,
        footnotes,
        same_maps,
        shown_layer,
        table_of,
    )
    from replay.terminal import pictures_beside, summary_lines, table_text

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
    click.echo(f"layer {layer}: █ wall, blank free, ░ undecided, · never seen\n")
    lines = comparison_lines(snapshots, layer, thresholds)
    click.echo(table_text(table_of(lines)))
    segments = {name: result.segments for name, result in results.items()}
    for note in (*footnotes(lines), *same_maps(snapshots, segments, thresholds)):
        click.echo(note)
    for each in variants:
        if each.note:
            click.echo(f"{each.name}: {each.note}")
    for told in comparison.distances.told():
        click.echo(told)
    _tell_readings({name: summary_lines(result.finished) for name, result in results.items()})
    left_out = next(iter(results.values())).left_out
    if left_out:
        click.echo(left_out)
    written = [str(path) for path in (rrd, export) if path is not None]
    if written:
        click.echo("wrote " + " and ".join(written))


def _tell_readings(told: Mapping[str, list[str]]) -> None:
    """How many readings each map used; once, where it is the same for all."""
    alike = len({tuple(lines) for lines in told.values()}) == 1
    for name, lines in told.items():
        for line in lines:
            click.echo(line if alike else f"{name}: {line}")
        if alike:
            return
