"""``demo``: the main job on a fresh machine."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.cli import options
from replay.cli.map_report import map_and_report

_SPEED = 4.0  # the demo's robot hurries, so that it has seen its room after some seconds


@click.command(epilog="Example:  echogrid demo --duration 20")
@click.option(
    "-o",
    "--output",
    type=options.FILE,
    help="Folder to write to; default ./echogrid-demo, then ./echogrid-demo-2 and so on.",
)
@click.option(
    "--room",
    default="room",
    show_default=True,
    help="Where it drives: a room's name (docs/simulator.md) or a GeoJSON file.",
)
@click.option(
    "--duration",
    type=options.Number(min=1),
    default=15.0,
    show_default=True,
    help="Seconds that are recorded.",
)
@click.option(
    "--seed", type=int, default=1, show_default=True, help="Of the robot's noise: any whole number."
)
@click.option("--no-view", is_flag=True, help="Do not open the viewer.")
@click.option("--force", is_flag=True, help="Write into a folder that is not empty.")
@options.quiet
def demo(
    output: Path | None, room: str, duration: float, seed: int, no_view: bool, force: bool,
    quiet: bool,
) -> int:  # fmt: skip
    """See it work: simulate a robot, record it, map it, show it."""
    from mapping.config import load_config
    from replay.demo import new_folder, record_demo
    from replay.rrd.program import has_display
    from replay.viewer import open_viewer

    folder = new_folder(output, "echogrid-demo", force=force)
    session, rrd = folder / "demo.mcap", folder / "demo.rrd"
    if not quiet:
        click.echo(f"recording {duration:.0f} s from a serial line into {session}", err=True)
    record_demo(session, room=room, duration_s=duration, seed=seed, speed=_SPEED, quiet=quiet)
    status = map_and_report(session, load_config(), rrd, None, force=True, quiet=quiet)
    if not quiet:
        click.echo(f"look:  echogrid view {rrd}    (in a browser: --web)")
    if not no_view and has_display():
        open_viewer(rrd)
    return status
