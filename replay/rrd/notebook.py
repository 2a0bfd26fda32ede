"""A recording inside a Jupyter notebook: the viewer as a widget.

The widget carries the viewer with it, so that a notebook needs no internet, and the browser may
sit on another machine than the kernel.
"""

from __future__ import annotations

import contextlib
import io
import os
from pathlib import Path
from typing import Any

from recorder.errors import BadInput

NEEDS_JUPYTER = (
    "show() needs the notebook viewer: pip install rerun-notebook==0.41.0 (the extra 'jupyter')"
)
WIDTH, HEIGHT_PX = "auto", 720
# Where the widget's program comes from; by default it would be fetched from the internet.
_ASSET, _INSIDE = "RERUN_NOTEBOOK_ASSET", "inline"


def widget(path: Path, *, width: int | str = WIDTH, height: int | str = HEIGHT_PX) -> Any:
    """The viewer with one recording, as a widget that a notebook displays.

    ``width`` and ``height`` are pixels or ``"auto"``. Raises BadInput where the recording cannot be
    read or the notebook viewer is not installed.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or error}") from None
    os.environ.setdefault(_ASSET, _INSIDE)
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it says how it was loaded
            from rerun_notebook import Viewer
    except ImportError:
        raise BadInput(NEEDS_JUPYTER) from None
    viewer = Viewer(width=width, height=height)
    viewer.send_rrd(data)
    return viewer
