"""``learn``: what a sensor is like."""

from __future__ import annotations

from pathlib import Path

import click

from mapping.cli import config_options
from recorder.cli import options
from recorder.cli.progress import progress_bar
from recorder.names import printable


@click.command(epilog="Example:  echogrid learn run.mcap --walls room -o sensors.toml")
@click.argument("sessions", nargs=-1, required=True, type=options.INPUT)
@click.option(
    "--walls", metavar="ROOM", multiple=True,
    help="True walls: a room's name or a GeoJSON file; one for all sessions, or repeated, one for "
    "each in order. Default: those that the sessions carry.",
)  # fmt: skip
@click.option(
    "--trust", metavar="SENSOR", help="Without walls: this sensor's map is taken as true."
)
@click.option(
    "--distance", "distances", metavar="M,M,...",
    help="The robot stood so far from a wall, by tape measure: one distance a session, in order.",
)  # fmt: skip
@click.option("--sensor", "only", multiple=True, help="Only this sensor; repeatable.")
@click.option(
    "--weights", is_flag=True,
    help="Also how strong its evidence should be: by true walls, tried on rooms kept out; without "
    "them by the readings that are kept out.",
)  # fmt: skip
@config_options
@click.option(
    "-o", "--output", type=options.FILE, help="The sensor file for `map --config`: .toml."
)
@click.option("--page", type=options.FILE, help="The verdict with plots: a .html.")
@click.option("--csv", "csv_file", type=options.FILE, help="Every reading and its truth: a .csv.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON, for programs.")
@options.force
@options.quiet
def learn(
    sessions: tuple[Path, ...], walls: tuple[str, ...], trust: str | None,
    distances: str | None, only: tuple[str, ...], weights: bool, configs: tuple[Path, ...],
    settings: tuple[str, ...], preset: str | None, output: Path | None, page: Path | None,
    csv_file: Path | None, as_json: bool, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Learn what a sensor is like: how far off and how often wrong.

    Against true walls, a tape measure, a sensor that is trusted, or its own map. docs/learn.md
    explains the figures.
    """
    import json

    from mapping.config import load_config
    from recorder.errors import BadInput
    from replay.learning import text
    from replay.learning.page import page as page_of
    from replay.learning.run import learn as run
    from replay.learning.strengths import strengths
    from replay.tables import text_table

    if weights and (trust or distances):
        raise BadInput("--weights goes by true walls or by readings kept out, not by --trust or "
                       "--distance")  # fmt: skip
    _check(sessions, {".toml": output, ".html": page, ".csv": csv_file}, force=force)
    config = load_config(configs, settings, preset)
    with progress_bar(f"learning from {sessions[0].name}", quiet=quiet):
        learned = run(
            sessions, config, walls=walls, trust=trust, distances_m=_distances(distances),
            only=only,
        )  # fmt: skip
        known = learned[0].against == "true walls"
        strong = (
            strengths(sessions, config, learned, walls=walls, known=known, only=only)
            if weights else []
        )  # fmt: skip
    names = [path.name for path in sessions]
    if as_json:
        click.echo(json.dumps(text.as_json(learned, strong), indent=1, allow_nan=False))
    elif not quiet:
        for each in learned:
            lines = [*text_table(text.table(each)), *text.verdict(each), ""]
            click.echo("\n".join(printable(line, most=400) for line in lines))
        for layer in strong:
            click.echo("\n".join(printable(line, most=400) for line in text.worth(layer)))
    _write(output, text.sensor_file(learned, names, strong))
    _write(page, page_of(learned, names))
    _write(csv_file, text.csv(learned))
    if not quiet and not as_json:
        for path in (output, page, csv_file):
            if path is not None:
                click.echo(f"wrote {path}")
    return 0


def _distances(text: str | None) -> list[float]:
    from recorder.errors import BadInput

    try:
        return [] if text is None else [float(part) for part in text.split(",")]
    except ValueError:
        raise BadInput(f"--distance {text}: write metres with commas, as 0.30,0.60") from None


def _check(inputs: tuple[Path, ...], outputs: dict[str, Path | None], *, force: bool) -> None:
    from recorder.errors import BadInput
    from recorder.outputs import check_output

    for suffix, output in outputs.items():
        if output is not None and output.suffix.lower() != suffix:
            raise BadInput(f"{output}: its name must end in {suffix}")
        if output is not None:
            check_output(output, inputs, force=force)


def _write(path: Path | None, content: str) -> None:
    from recorder.outputs import written_beside

    if path is not None:
        with written_beside(path) as part:
            part.write_text(content, encoding="utf-8")
