"""``diff``: how two maps, or the maps of two sessions, differ."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mapping.cli import config_options, plugin_option
from recorder.cli import options
from recorder.cli.progress import progress_bar
from recorder.names import printable

if TYPE_CHECKING:
    from replay.diff.comparing import Report


@click.command(
    "diff", epilog="Example:  echogrid diff before.mcap after.mcap --tolerance 0.01 -o diff.png"
)
@click.argument("a", type=options.INPUT)
@click.argument("b", type=options.INPUT)
@config_options
@plugin_option
@click.option(
    "--tolerance", type=options.Number(min=0), default=0.0, show_default=True,
    help="Cells differ when their values (probabilities, with most rules) lie further apart.",
)  # fmt: skip
@click.option(
    "--line-tolerance", "line_tolerance_m", type=options.Number(min=0), default=1e-6,
    show_default=True, help="Lines differ when an end moved further, in metres.",
)  # fmt: skip
@click.option("--layer", "layers", multiple=True, help="Only this layer; repeatable.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON, for programs.")
@click.option(
    "-o",
    "--output",
    type=options.FILE,
    help="Draw the difference: a picture (.png) or a recording (.rrd).",
)
@options.force
@options.quiet
def diff(
    a: Path, b: Path, configs: tuple[Path, ...], settings: tuple[str, ...], preset: str | None,
    plugins: tuple[Path, ...], tolerance: float, line_tolerance_m: float, layers: tuple[str, ...],
    as_json: bool, output: Path | None, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Report what differs between two maps, sessions or recordings.

    A and B are sessions, .rrd, .npz, map_server maps or export folders.

    Of an .rrd that holds several maps, name one: rules.rrd#bayes.

    Sessions are mapped first, both with one configuration; one session beside a map is mapped
    with the configuration that made the map, unless you give one. Exit code 0: the same.
    1: they differ. 2: they cannot be compared.
    """
    from mapping.config import load_config
    from mapping.plugins import load_plugin
    from replay.diff.comparing import compare

    _check_output(output, (a, b), force=force)
    for plugin in plugins:
        load_plugin(plugin)
    config = load_config(configs, settings, preset) if configs or settings or preset else None
    with progress_bar(f"comparing {a.name} and {b.name}", quiet=quiet) as advance:
        report = compare(
            a, b, config, tolerance=tolerance, line_tolerance_m=line_tolerance_m, only=layers,
            progress=advance,
        )  # fmt: skip
    _print(report, as_json=as_json, quiet=quiet)
    if output is not None:
        _write(report, output)
        if not quiet and not as_json:
            click.echo(f"wrote {output}")
    return 1 if report.differs or report.a.damaged or report.b.damaged else 0


def _check_output(output: Path | None, inputs: tuple[Path, ...], *, force: bool) -> None:
    import tempfile

    from recorder.errors import BadInput
    from recorder.foreign import calling
    from recorder.outputs import check_output

    if output is None:
        return
    if output.suffix.lower() not in (".png", ".rrd"):
        raise BadInput(f"{output}: a comparison is written as .png or .rrd")
    check_output(output, inputs, force=force)
    with calling(output, "writing it"):  # found out before all the work
        there = next(folder for folder in output.absolute().parents if folder.exists())
        tempfile.TemporaryFile(dir=there).close()


def _print(report: Report, *, as_json: bool, quiet: bool) -> None:
    import json

    from replay.diff.report_text import as_json as plain
    from replay.diff.report_text import summary

    if as_json:
        click.echo(json.dumps(plain(report), indent=1, ensure_ascii=False, allow_nan=False))
    elif not quiet:
        for line in summary(report):
            click.echo(printable(line))


def _write(report: Report, output: Path) -> None:
    if output.suffix.lower() == ".png":
        from replay.diff.picture import save_picture

        save_picture(report, output)
    else:
        from replay.rrd.difference import write_difference

        write_difference(report, output)
