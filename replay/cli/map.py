"""``map``: a session into an .rrd recording and exports."""

from __future__ import annotations

from pathlib import Path

import click

from mapping.cli import config_options
from recorder.cli import options
from replay.cli.telling import map_and_tell


@click.command("map", epilog="Example:  echogrid map run.mcap -o run.rrd --export out")
@click.argument("session", type=options.FILE)
@click.option("-o", "--output", required=True, help="The .rrd to write; - for none.")
@config_options[0]
@config_options[1]
@config_options[2]
@click.option("--export", type=options.FILE, help="Folder for grids, map files, borders and lines.")
@click.option(
    "--plugin", "plugins", type=options.FILE, multiple=True, help="A rule or model of your own."
)
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
    return map_and_tell(
        session, load_config(configs, extra, preset), rrd, export, force=force, quiet=quiet
    )
