"""``echogrid.show``: a recording, or what a run came to, inside a notebook: the viewer as a widget.

The widget carries the viewer with it, so that a notebook needs no internet, and the browser may
sit on another machine than the kernel.
"""

from __future__ import annotations

import contextlib
import io
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recorder.errors import BadInput

if TYPE_CHECKING:
    from replay.mapping_run import RunResult

NEEDS_JUPYTER = (
    "show() needs the notebook viewer: pip install rerun-notebook==0.41.0 (the extra 'jupyter')"
)
WIDTH, HEIGHT_PX = "auto", 720
# Where the widget's program comes from; by default it would be fetched from the internet.
_ASSET, _INSIDE = "RERUN_NOTEBOOK_ASSET", "inline"


def show(
    run: str | os.PathLike[str] | RunResult,
    *,
    width: int | str = WIDTH,
    height: int | str = HEIGHT_PX,
) -> Any:
    """The viewer as a widget: put it last in a cell, and the notebook displays it.

    ``run`` is the path of a recording (``.rrd``), or what :func:`map_session` returned; ``width``
    and ``height`` are pixels or ``"auto"``. Raises BadInput, in one line, for a run that wrote no
    recording, a file that cannot be read, or without the notebook viewer (the extra ``jupyter``).
    """
    path = Path(run) if isinstance(run, str | os.PathLike) else run.rrd
    if path is None:
        raise BadInput("this run wrote no recording; map the session with rrd=Path('run.rrd')")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or error}") from None
    os.environ.setdefault(_ASSET, _INSIDE)
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it reports how it was loaded
            from rerun_notebook import Viewer
    except ImportError:
        raise BadInput(NEEDS_JUPYTER) from None
    viewer = Viewer(width=width, height=height)
    viewer.send_rrd(data)
    return viewer
