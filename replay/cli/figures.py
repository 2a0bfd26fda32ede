"""``figures``: every figure of the lecture chapter, redrawn from one session."""

from __future__ import annotations

from pathlib import Path

import click

from mapping.cli import config_options
from recorder.cli import options
from recorder.cli.progress import progress_bar, warn


@click.command("figures", epilog="Example:  echogrid figures run.mcap -o figures")
@click.argument("session", type=options.INPUT)
@click.option(
    "-o", "--output", "directory", type=options.FILE, required=True, help="Folder to write to."
)
@click.option(
    "--only", type=click.IntRange(min=1), multiple=True, help="This figure alone; repeatable."
)
@config_options
@click.option("--force", is_flag=True, help="Replace files of the same names in the folder.")
@options.quiet
def figures(
    session: Path, directory: Path, only: tuple[int, ...], configs: tuple[Path, ...],
    settings: tuple[str, ...], preset: str | None, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Draw every figure of the lecture chapter from a SESSION.

    Each becomes a numbered PNG with its caption and an SVG; index.html shows all, ready to print.
    Figures that the session cannot have (of a sensor that it lacks) are left out and reported. The
    figures show the chapter's own models; the configuration gives poses, mounts and beams.
    """
    from mapping.config import load_config
    from replay.pictures.figures.table import NUMBERED
    from replay.pictures.figures.writing import PAGE, write_figures

    config = load_config(configs, settings, preset)
    with progress_bar(f"figures of {session.name}", quiet=quiet) as advance:
        outcome = write_figures(
            session, directory, config, only=only, force=force, progress=advance
        )
    if not quiet:
        for note in outcome.notes:
            click.echo(note)
        for number, why in outcome.left_out:
            click.echo(f"left out: {number}. {NUMBERED[number].title}: {why}")
        click.echo(f"wrote {len(outcome.made)} figures and {directory / PAGE}")
    for reason in outcome.damage:
        warn(reason)
    return 1 if outcome.damage else 0
