"""``info``: what is in a session, and what is wrong with it."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.cli import options


@click.command(epilog="Example:  echogrid info run.mcap")
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=options.FILE)
@options.quiet
def info(files: tuple[Path, ...], quiet: bool) -> int:
    """What is in a session, and what is wrong with it: rates, gaps, odd channels, losses.

    Exit code 0: all of it can be read; 1: something is lost; 2: it cannot be used.
    """
    from rich.console import Console
    from rich.progress import Progress

    from recorder.session import SessionReader
    from recorder.summary import summary_lines

    damaged = False
    console = Console(stderr=True)
    for file in files:
        reader = SessionReader(file)
        with Progress(
            console=console, transient=True, disable=quiet or not console.is_terminal
        ) as bar:
            size = file.stat().st_size if file.exists() else None
            task = bar.add_task(f"reading {file.name}", total=size)
            advance = lambda done, task=task: bar.update(task, completed=done)  # noqa: E731
            lines = list(summary_lines(reader, advance))
        for line in lines if not quiet else ():
            click.echo(line)
        damaged = damaged or bool(reader.damage)
    return 1 if damaged else 0
