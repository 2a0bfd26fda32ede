"""``score``: how right a map is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mapping.cli import config_options, plugin_option
from recorder.cli import options
from recorder.cli.progress import progress_bar
from recorder.names import printable

if TYPE_CHECKING:
    from replay.scoring.judging import ScoreReport


@click.command("score", epilog="Example:  echogrid score run.mcap --walls room -o score.png")
@click.argument("map", type=options.INPUT)
@click.option(
    "--walls", metavar="ROOM",
    help="What is true: a room's name, a GeoJSON file of walls, or a map_server map (.yaml). "
    "Default: the walls that the session carries.",
)  # fmt: skip
@click.option(
    "--session", type=options.INPUT,
    help="The session that an exported map was made of: only what it could see is judged.",
)  # fmt: skip
@config_options
@plugin_option
@click.option("--layer", "layers", multiple=True, help="Only this layer; repeatable.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON, for programs.")
@click.option("-o", "--output", type=options.FILE, help="Draw what is right and wrong: a .png.")
@options.force
@options.quiet
def score(
    map: Path, walls: str | None, session: Path | None, configs: tuple[Path, ...],
    settings: tuple[str, ...], preset: str | None, plugins: tuple[Path, ...],
    layers: tuple[str, ...], as_json: bool, output: Path | None, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Judge a map and its lines against known walls.

    MAP is a session, which is mapped first, or a map: an export folder, .npz, .rrd or map_server
    file. A session is also judged without truth: by how well the map of most readings predicts
    the others. docs/score.md explains the figures.
    """
    from mapping.config import load_config
    from mapping.plugins import load_plugin
    from replay.scoring.judging import judge_map

    inputs = tuple(path for path in (map, session) if path is not None)
    _check_output(output, inputs, force=force)
    for plugin in plugins:
        load_plugin(plugin)
    config = load_config(configs, settings, preset) if configs or settings or preset else None
    with progress_bar(f"judging {map.name}", quiet=quiet) as advance:
        report = judge_map(
            map, walls=walls, session=session, config=config, only=layers, progress=advance
        )
    _print(report, as_json=as_json, quiet=quiet)
    if output is not None:
        from replay.scoring.picture import save_picture

        save_picture(report, output)
        if not quiet and not as_json:
            click.echo(f"wrote {output}")
    return 1 if report.damaged else 0


def _check_output(output: Path | None, inputs: tuple[Path, ...], *, force: bool) -> None:
    from recorder.errors import BadInput
    from recorder.outputs import check_output

    if output is None:
        return
    if output.suffix.lower() != ".png":
        raise BadInput(f"{output}: a score is drawn as .png")
    check_output(output, inputs, force=force)


def _print(report: ScoreReport, *, as_json: bool, quiet: bool) -> None:
    import json

    from replay.scoring.report_text import as_json as plain
    from replay.scoring.report_text import summary

    if as_json:
        click.echo(json.dumps(plain(report), indent=1, ensure_ascii=False, allow_nan=False))
    elif not quiet:
        for line in summary(report):
            click.echo(printable(line))
