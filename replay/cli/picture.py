"""``picture``: a map, or a step on its way, as PNG, SVG or PDF for slides and documents."""

from __future__ import annotations

from pathlib import Path

import click

from mapping.cli import config_options, plugin_option
from recorder.cli import options
from recorder.cli.progress import progress_bar


@click.command(
    "picture", epilog="Example:  echogrid picture run.rrd --reading 40 --view ping -o slide.png"
)
@click.argument("files", nargs=-1, required=True, type=options.INPUT)
@click.option("-o", "--output", type=options.FILE, required=True, help="A .png, .svg or .pdf.")
@click.option("--step", type=click.IntRange(min=0), help="The map at this step of the recording.")
@click.option(
    "--reading", type=click.IntRange(min=0), help="The map after this reading, with its beam."
)
@click.option("--view", default="", help="Layer to show, or classes; default: the clearest.")
@click.option(
    "--compare", type=options.INPUT, multiple=True,
    help="Another file, in a panel beside it at the same scale; repeatable.",
)  # fmt: skip
@click.option("--whole", is_flag=True, help="All cells, not only those around path and walls.")
@config_options
@plugin_option
@options.force
@options.quiet
def picture(
    files: tuple[Path, ...], output: Path, step: int | None, reading: int | None, view: str,
    compare: tuple[Path, ...], whole: bool, configs: tuple[Path, ...], settings: tuple[str, ...],
    preset: str | None, plugins: tuple[Path, ...], force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Draw a map with its walls, path and scale.

    FILES are recordings (.rrd), sessions (.mcap; these are mapped first, with the configuration
    given) or exported maps: .npz, map_server's .yaml, or a folder. Several stand side by side; of a
    recording that compares maps all are shown, or one: rules.rrd#bayes.
    """
    from mapping.config import load_config
    from mapping.plugins import load_plugin
    from recorder.errors import BadInput
    from replay.pictures.opening import Asked
    from replay.pictures.writing import write_picture

    if step is not None and reading is not None:
        raise BadInput("--step and --reading are two ways to name a moment: give one")
    for plugin in plugins:
        load_plugin(plugin)
    config = load_config(configs, settings, preset)
    first, *more = files
    with progress_bar(f"drawing {output.name}", quiet=quiet) as advance:
        drawn = write_picture(
            [first, *compare, *more], output, Asked(step, reading, view), config, whole=whole,
            force=force, progress=advance,
        )  # fmt: skip
    if not quiet:
        click.echo(drawn.caption)
        click.echo(f"wrote {drawn.output}")
    return 0
