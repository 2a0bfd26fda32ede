"""``map``: a session into an .rrd recording and exports."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mapping.cli import plugin_option, preset_option, setting_option
from recorder.cli import options
from recorder.errors import BadInput
from replay.cli.map_report import compare_and_report, map_and_report

if TYPE_CHECKING:
    from replay.comparison import Variant


FARTHEST_M = 1e6
Point = tuple[float, float]


def _pose(context: click.Context, parameter: click.Parameter, given: str | None) -> str | None:
    """The pose as it goes into the configuration; a usage error where it is not three numbers."""
    if given is None:
        return None
    try:
        x, y, deg = (float(part) for part in given.split(","))
    except ValueError:
        raise click.BadParameter(
            f"{given!r} is not x,y,deg (metres, degrees), as in 0.5,0.6,90"
        ) from None
    return f"{x},{y},{deg}"


def _points(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[Point, ...]:
    """The points; a usage error in one line where there are not two numbers."""
    points = []
    for text in given:
        try:
            x, y = (float(part) for part in text.split(","))
        except ValueError:
            raise click.BadParameter(f"{text!r} is not x,y in metres, as in 1.25,0.5") from None
        if not max(abs(x), abs(y)) <= FARTHEST_M:  # nor is it a number
            raise click.BadParameter(f"{text!r} is no place that a robot gets to")
        points.append((x, y))
    return tuple(points)


@click.command("map", epilog="Example:  echogrid map run.mcap -o run.rrd --export out")
@click.argument("sessions", nargs=-1, required=True, type=options.INPUT)
@click.option(
    "-o", "--output", help="The .rrd to write; - for none; default: SESSION.rrd beside it."
)
@click.option(
    "--config",
    "configs",
    type=options.INPUT,
    multiple=True,
    help="Configuration to use, a TOML file as `echogrid config` prints; several make several "
    "maps, side by side.",
)
@setting_option
@preset_option
@click.option(
    "--compare",
    metavar="WHAT",
    help="Several maps side by side: rules, models, pose, or A.B=C,D with all values of one key.",
)
@click.option("--export", type=options.FILE, help="Folder to write grids, borders and lines to.")
@click.option(
    "--mcap", "bag", type=options.FILE,
    help="ROS 2 bag to write the maps to, with path and TF: a .mcap.",
)  # fmt: skip
@plugin_option
@click.option(
    "--pose",
    metavar="X,Y,DEG",
    callback=_pose,
    help="The robot stood still here (metres, degrees): no tracker needed.",
)
@click.option(
    "--stamps",
    type=click.Choice(["header", "arrival"]),
    help="Go by the times of measurement (default), or by those at which the messages arrived.",
)
@click.option(
    "--probe", "probes", metavar="X,Y", multiple=True, callback=_points,
    help="Why is the cell at x,y (metres) so? Repeatable.",
)  # fmt: skip
@click.option(
    "--rrd-budget-mb",
    type=options.Number(min=1),
    help="MB that the .rrd should stay under; default: 100.",
)
@click.option("--force", is_flag=True, help="Replace outputs that exist.")
@options.quiet
def map_(
    sessions: tuple[Path, ...], output: str | None, configs: tuple[Path, ...],
    settings: tuple[str, ...], preset: str | None, compare: str | None, export: Path | None,
    bag: Path | None, plugins: tuple[Path, ...], pose: str | None, stamps: str | None,
    probes: tuple[Point, ...], rrd_budget_mb: float | None, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Map a SESSION, and write every step into an .rrd recording.

    Several files are one session: its parts, or runs of one robot in one place.
    """
    from mapping.config import load_config

    if plugins:
        from mapping.plugins import load_plugin

        for plugin in plugins:
            load_plugin(plugin)
    extra = [*settings]
    if pose is not None:
        extra.append(f"pose.fixed=[{pose}]")
    if stamps is not None:
        extra.append(f"pose.stamps={stamps}")
    if rrd_budget_mb is not None:
        extra.append(f"rerun.budget_mb={rrd_budget_mb}")
    beside = sessions[0].with_suffix(".rrd")
    rrd = None if output == "-" else beside if output is None else Path(output)
    if rrd is not None and rrd.suffix == ".mcap":
        raise BadInput(f"{rrd}: -o is the .rrd recording; --mcap {rrd} writes maps for ROS 2")
    if rrd is not None and rrd.suffix != ".rrd":  # by which the viewer knows it
        raise BadInput(f"{rrd}: the name of a recording must end in .rrd")
    if bag is not None and bag.suffix != ".mcap":
        raise BadInput(f"{bag}: the name of a bag must end in .mcap")
    session, *more = sessions
    if compare is not None or len(configs) > 1:
        variants = _variants(configs, compare, extra, preset)
        if probes:
            raise BadInput("--probe follows a cell of one map, not of several side by side")
        if bag is not None:
            raise BadInput("--mcap writes the maps of one configuration, not of several")
        return compare_and_report(
            session, variants, rrd, export, more=more, force=force, quiet=quiet
        )
    return map_and_report(
        session, load_config(configs, extra, preset), rrd, export, bag=bag, probes=probes,
        more=more, force=force, quiet=quiet,
    )  # fmt: skip


def _variants(
    configs: tuple[Path, ...], compare: str | None, settings: list[str], preset: str | None
) -> list[Variant]:
    """Several maps: of one file each, or of one setting's values."""
    from replay.comparison import from_files, from_values

    if compare is None:
        return from_files(configs, settings, preset)
    if len(configs) > 1:
        raise BadInput("--compare varies one configuration: give one --config with it, or none")
    return from_values(compare, configs, settings, preset)
