"""``info``: what is in a session, and what is wrong with it."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.cli import options


@click.command(epilog="Example:  echogrid info run.mcap")
@click.argument("file", type=options.FILE)
def info(file: Path) -> int:
    """What is in a session, and what is wrong with it."""
    from recorder.session import read_session
    from recorder.summary import summary_lines

    session = read_session(file)
    for line in summary_lines(session):
        click.echo(line)
    return 1 if session.damage else 0
