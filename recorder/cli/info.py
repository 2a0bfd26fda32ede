"""``info``: what is in a session, and what is wrong with it."""

from __future__ import annotations

import functools
from pathlib import Path

import click

from recorder.cli import options
from recorder.cli.progress import progress_bar


@click.command(epilog="Example:  echogrid info run.mcap")
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=options.FILE)
@options.quiet
def info(files: tuple[Path, ...], quiet: bool) -> int:
    """Show what is in a session, and what is wrong with it.

    That is rates, gaps, what a map would be made of, odd channels and losses.

    Exit code 0: all of it can be read; 1: something is lost; 2: it cannot be used.
    """
    from recorder.session import SessionReader, session_files
    from recorder.summary import summary_lines

    damaged = False
    for file in session_files(*files):
        reader = SessionReader(file)
        size = file.stat().st_size if file.exists() else None
        with progress_bar(f"reading {file.name}", quiet=quiet) as advance:
            lines = list(summary_lines(reader, functools.partial(advance, total=size)))
        for line in lines if not quiet else ():
            click.echo(line)
        damaged = damaged or bool(reader.damage)
    return 1 if damaged else 0
