"""``echogrid.show``: a recording, or what a run came to, inside a notebook: the viewer as a widget.

The widget carries the viewer with it, so that a notebook needs no internet, and the browser may
sit on another machine than the kernel.
"""

from __future__ import annotations

import contextlib
import functools
import io
import json
import os
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mapping.config import MappingConfig, validate
from recorder.errors import BadInput, EchogridError
from replay import probe_text
from replay.rrd import layout

if TYPE_CHECKING:
    from replay.mapping_run import RunResult

Point = tuple[float, float]

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
    session: str | os.PathLike[str] | None = None,
) -> Any:
    """The viewer as a widget: put it last in a cell, and the notebook displays it.

    ``run`` is the path of a recording (``.rrd``), or what :func:`map_session` returned; ``width``
    and ``height`` are pixels or ``"auto"``. With the ``session`` that it was mapped from, a click
    on a cell of a map asks why the cell is so; the answer appears below. Raises BadInput, in one
    line, for a run that wrote no recording, a file that cannot be read, or without the notebook
    viewer (the extra ``jupyter``).
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
    if session is None:
        return viewer
    return _with_answers(viewer, functools.partial(why, Path(session), config_of(path)))


def config_of(rrd: Path) -> MappingConfig:
    """The configuration that a recording was made with. Raises BadInput for no recording."""
    from replay.rrd.reader import read_rrd

    return validate(tomllib.loads(read_rrd(rrd).config_text))


def why(session: Path, config: MappingConfig, at_m: Point) -> str:
    """Why the cell at a point of the map is as it is, in Markdown, by mapping the session anew."""
    from replay.mapping_run import map_session

    try:
        result = map_session(session, config, rrd=None, export=None, probes=[at_m])
    except EchogridError as error:
        return str(error)
    layers = tuple(snapshot.layer.name for snapshot in result.snapshots)
    return probe_text.explanation(result.probes[0], layers)


def clicked_m(event: str) -> Point | None:
    """The point of the map (x, y) that was clicked at, metres; None for any other event.

    ``event`` is what the viewer sends, as JSON. In its plane y runs down.
    """
    sent = json.loads(event)
    if sent.get("type") != "selection_change":
        return None
    for item in sent.get("items", ()):
        place = item.get("position")
        if str(item.get("entity_path", "")).startswith(f"{layout.MAP}/") and place:
            return float(place[0]), -float(place[1])
    return None


def _with_answers(viewer: Any, answer: Callable[[Point], str]) -> Any:
    """The viewer, and below it what it answers to the last click."""
    import ipywidgets
    from IPython import display

    below = ipywidgets.Output()

    def show_text(markdown: str) -> None:
        below.outputs = ()
        below.append_display_data(display.Markdown(markdown))  # type: ignore[no-untyped-call]

    show_text("Click a cell of a map to ask why it is so.")

    def take(event: str) -> None:
        at_m = clicked_m(event)
        if at_m is None:
            return
        x, y = at_m
        show_text(f"Asking at ({x:.3f}, {y:.3f}) m ...")
        show_text(answer(at_m))

    viewer._on_raw_event(take)
    return ipywidgets.VBox([viewer, below])
