"""Mapping with a progress bar, and what is said of it afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from mapping.config import MappingConfig
    from replay.mapping_run import RunResult


def map_and_tell(
    session: Path, config: MappingConfig, rrd: Path | None, export: Path | None, *, force: bool,
    quiet: bool, probes: Sequence[tuple[float, float]] = (), more: Sequence[Path] = (),
) -> int:  # fmt: skip
    from rich.console import Console
    from rich.progress import Progress

    from replay.mapping_run import map_session

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task(f"mapping {session.name}", total=None)
        result = map_session(
            session, config, more=more, rrd=rrd, export=export, force=force, probes=probes,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )  # fmt: skip
    for reason in result.damage:
        click.echo(f"echogrid: {session}: {reason}", err=True)
    if not quiet:
        tell(result, rrd, export)
    return 1 if result.damage else 0


def tell(result: RunResult, rrd: Path | None, export: Path | None) -> None:
    from replay.probe_words import answer
    from replay.terminal import picture, summary_lines

    shown = result.snapshots[-1].layer  # the fused one, where there is one
    click.echo(picture(shown.probability, shown.observed))
    click.echo(f"layer {shown.name}: █ wall, blank free, ░ undecided, · never seen")
    for line in summary_lines(result.finished):
        click.echo(line)
    walls = sum(s.source == "grid" and s.layer == shown.name for s in result.segments)
    click.echo(f"{walls} line segments in layer {shown.name}")
    layers = tuple(snapshot.layer.name for snapshot in result.snapshots)
    for probe in result.probes:
        click.echo("\n".join(["", *answer(probe, layers)]))
    if result.left_out:
        click.echo(result.left_out)
    written = [str(path) for path in (rrd, export) if path is not None]
    if written:
        click.echo("wrote " + " and ".join(written))
