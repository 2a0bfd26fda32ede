"""``echogrid.show``: look at a recording, or at what a run came to, inside a notebook."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from recorder.errors import BadInput
from replay.mapping_run import RunResult


def show(
    run: str | os.PathLike[str] | RunResult,
    *,
    width: int | str = "auto",
    height: int | str = 720,
) -> Any:
    """The viewer as a widget: put it last in a cell, and the notebook displays it.

    ``run`` is the path of a recording (``.rrd``), or what :func:`map_session` returned. Raises
    BadInput, in one line, for a run that wrote no recording, a file that cannot be read, or where
    the notebook viewer (the extra ``jupyter``) is not installed.
    """
    path = run.rrd if isinstance(run, RunResult) else Path(run)
    if path is None:
        raise BadInput("this run wrote no recording; map the session with rrd=Path('run.rrd')")
    from replay.rrd.notebook import widget

    return widget(path, width=width, height=height)
