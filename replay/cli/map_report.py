"""Mapping with a progress bar, and what is said of it afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from recorder.cli.progress import progress_bar

if TYPE_CHECKING:
    from mapping.config import MappingConfig
    from replay.mapping_run import RunResult


def map_and_report(
    session: Path, config: MappingConfig, rrd: Path | None, export: Path | None, *, force: bool,
    quiet: bool, probes: Sequence[tuple[float, float]] = (), more: Sequence[Path] = (),
) -> int:  # fmt: skip
    from replay.mapping_run import map_session

    with progress_bar(f"mapping {session.name}", quiet=quiet) as advance:
        result = map_session(
            session, config, more=more, rrd=rrd, export=export, force=force, probes=probes,
            progress=advance,
        )  # fmt: skip
    status = tell_damage(session, result.damage)
    if not quiet:
        _tell(result)
        _tell_unknown_sensors(config, result)
        tell_files(result.left_out, rrd, export)
    return status


def tell_files(left_out: str, rrd: Path | None, export: Path | None) -> None:
    """Say what was written, and what of it was left out."""
    if left_out:
        click.echo(left_out)
    written = [str(path) for path in (rrd, export) if path is not None]
    if written:
        click.echo("wrote " + " and ".join(written))


def tell_damage(session: Path, damage: Sequence[str]) -> int:
    """Say what of the session is lost; the exit code."""
    for reason in damage:
        click.echo(f"echogrid: {session}: {reason}", err=True)
    return 1 if damage else 0


def _tell_unknown_sensors(config: MappingConfig, result: RunResult) -> None:
    """A sensor that the configuration names and the map lacks may be a misspelt one."""
    used = result.finished.used
    for name in config.sensors:
        if name != "*" and name not in used:
            click.echo(
                f"echogrid: sensors.{name} is configured, but the map has no reading of it "
                f"(it has {', '.join(used)})",
                err=True,
            )


def _tell(result: RunResult) -> None:
    from replay.probe_words import answer
    from replay.terminal import map_lines

    maps = {snapshot.layer.name: snapshot.layer for snapshot in result.snapshots}
    shown = maps[result.clearest]
    for line in map_lines(shown, result.finished):
        click.echo(line)
    walls = sum(s.source == "grid" and s.layer == shown.name for s in result.segments)
    click.echo(f"{walls} line segments in layer {shown.name}")
    others = [name for name in maps if name != shown.name]
    if others:
        click.echo(f"further layers: {', '.join(others)}")
    for probe in result.probes:
        click.echo("\n".join(["", *answer(probe, tuple(maps))]))
