"""``view``: a recording in the Rerun viewer."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from recorder.cli import options


@click.command(epilog="Example:  echogrid view run.rrd --web")
@click.argument("file", type=options.FILE)
@click.option("--web", is_flag=True, help="In the browser, served on 127.0.0.1.")
def view(file: Path, web: bool) -> int:
    """Open a recording in the Rerun viewer."""
    from recorder.errors import BadInput
    from replay.viewer import open_viewer

    if not file.is_file():
        raise BadInput(f"{file}: no such file")
    open_viewer(file, web=web, announce=lambda line: click.echo(line, file=sys.stdout))
    return 0
