"""The commands that show: demo, map, view."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mapping.cli import config_options

if TYPE_CHECKING:
    from mapping.config import MappingConfig
    from replay.mapping_run import RunResult

FILE = click.Path(path_type=Path)
_DEMO_SPEED = 4.0  # the demo's robot hurries, so that it has seen its room after some seconds


@click.command(epilog="Example:  echogrid demo --duration 20")
@click.option("-o", "--output", type=FILE, help="Folder; default ./echogrid-demo, numbered.")
@click.option("--room", default="room", show_default=True)
@click.option("--duration", type=click.FloatRange(min=1), default=15.0, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
@click.option("--no-view", is_flag=True, help="Do not open the viewer.")
@click.option("--force", is_flag=True, help="Write into a folder that is not empty.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def demo(
    output: Path | None, room: str, duration: float, seed: int, no_view: bool, force: bool,
    quiet: bool,
) -> int:  # fmt: skip
    """The main job: a simulated robot on a real serial line, recorded, mapped and shown."""
    from mapping.config import load_config
    from replay.demo import demo_folder, record_demo

    folder = demo_folder(output, force=force)
    session, rrd = folder / "demo.mcap", folder / "demo.rrd"
    if not quiet:
        click.echo(f"recording {duration:.0f} s from a serial line into {session}", err=True)
    record_demo(session, room=room, duration_s=duration, seed=seed, speed=_DEMO_SPEED, quiet=quiet)
    status = _map_and_tell(session, load_config(), rrd, None, force=True, quiet=quiet)
    if not quiet:
        click.echo(f"look:  echogrid view {rrd}    (in a browser: --web)")
    if not no_view and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        from replay.viewer import open_viewer

        open_viewer(rrd)
    return status


@click.command("map", epilog="Example:  echogrid map run.mcap -o run.rrd --export out")
@click.argument("session", type=FILE)
@click.option("-o", "--output", required=True, help="The .rrd to write; - for none.")
@config_options[0]
@config_options[1]
@config_options[2]
@click.option("--export", type=FILE, help="Folder for grids, map files, borders and lines.")
@click.option("--plugin", "plugins", type=FILE, multiple=True, help="A rule or model of your own.")
@click.option("--pose", help="x,y,deg of a robot that stood still: no tracker needed.")
@click.option("--rrd-budget-mb", type=click.FloatRange(min=1), help="Size the .rrd stays under.")
@click.option("--force", is_flag=True, help="Replace outputs that exist.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def map_(
    session: Path, output: str, configs: tuple[Path, ...], settings: tuple[str, ...],
    preset: str | None, export: Path | None, plugins: tuple[Path, ...], pose: str | None,
    rrd_budget_mb: float | None, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Map a SESSION, every step into an .rrd recording."""
    from mapping.config import load_config
    from mapping.plugins import load_plugin

    for plugin in plugins:
        load_plugin(plugin)
    extra = [*settings]
    if pose is not None:
        extra.append(f"pose.fixed=[{pose}]")
    if rrd_budget_mb is not None:
        extra.append(f"rerun.budget_mb={rrd_budget_mb}")
    rrd = None if output == "-" else Path(output)
    return _map_and_tell(
        session, load_config(configs, extra, preset), rrd, export, force=force, quiet=quiet
    )


def _map_and_tell(
    session: Path, config: MappingConfig, rrd: Path | None, export: Path | None, *, force: bool,
    quiet: bool,
) -> int:  # fmt: skip
    from rich.console import Console
    from rich.progress import Progress

    from replay.mapping_run import map_session

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task(f"mapping {session.name}", total=None)
        result = map_session(
            session, config, rrd=rrd, export=export, force=force,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )  # fmt: skip
    for reason in result.damage:
        click.echo(f"echogrid: {session}: {reason}", err=True)
    if not quiet:
        _tell(result, rrd, export)
    return 1 if result.damage else 0


def _tell(result: RunResult, rrd: Path | None, export: Path | None) -> None:
    from replay.terminal import picture, summary_lines

    shown = result.snapshots[-1].layer  # the fused one, where there is one
    click.echo(picture(shown.probability, shown.observed))
    click.echo(f"layer {shown.name}: █ wall, blank free, ░ undecided, · never seen")
    for line in summary_lines(result.finished):
        click.echo(line)
    walls = sum(s.source == "grid" and s.layer == shown.name for s in result.segments)
    click.echo(f"{walls} line segments in layer {shown.name}")
    if result.left_out:
        click.echo(result.left_out)
    written = [str(path) for path in (rrd, export) if path is not None]
    if written:
        click.echo("wrote " + " and ".join(written))


@click.command(epilog="Example:  echogrid view run.rrd --web")
@click.argument("file", type=FILE)
@click.option("--web", is_flag=True, help="In the browser, served on 127.0.0.1.")
def view(file: Path, web: bool) -> int:
    """Open a recording in the Rerun viewer."""
    from recorder.errors import BadInput
    from replay.viewer import open_viewer

    if not file.is_file():
        raise BadInput(f"{file}: no such file")
    open_viewer(file, web=web, announce=lambda line: click.echo(line, file=sys.stdout))
    return 0


COMMANDS = (demo, map_, view)
