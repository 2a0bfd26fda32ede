"""``view``: a recording, or a folder of them, in the Rerun viewer."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.cli import options


@click.command(epilog="Example:  echogrid view run.rrd --web")
@click.argument("file", metavar="FILE|FOLDER", type=options.INPUT)
@click.option(
    "--web",
    is_flag=True,
    help="In the browser instead of a window, served on 127.0.0.1; Ctrl-C ends it.",
)
def view(file: Path, web: bool) -> int:
    """Open a recording, or a folder of them, in the Rerun viewer.

    A folder is shown as a table with a card for each run, with the map that it ends with.
    """
    from replay.viewer import open_viewer

    open_viewer(file, web=web, announce=click.echo)
    return 0
