"""``echogrid.show``: the widget holds the whole recording; without the extra, one clear line."""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT

import echogrid
from mapping.config import load_config
from recorder.errors import BadInput
from replay.mapping_run import RunResult, map_session
from replay.rrd.notebook import NEEDS_JUPYTER, clicked_m, config_of

ROOM = ROOT / "logs" / "room.mcap"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    path = tmp_path_factory.mktemp("notebook") / "room.rrd"
    config = load_config(settings=["grid.resolution_m=0.1", "rerun.every=20"])
    return map_session(ROOM, config, rrd=path, export=None)


@pytest.mark.parametrize("by", ["result", "path", "text"])
def test_the_widget_hands_the_whole_recording_to_the_browser(
    run: RunResult, by: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run.rrd is not None
    given = {"result": run, "path": run.rrd, "text": str(run.rrd)}[by]
    widget = echogrid.show(given, width=900, height="auto")
    sent: list[tuple[object, object]] = []
    monkeypatch.setattr(  # no kernel here: what the page would get is caught instead
        "ipywidgets.Widget.send", lambda _, content, buffers=None: sent.append((content, buffers))
    )
    widget._on_ready()  # what the page says once it is loaded
    assert sent == [({"type": "rrd"}, [run.rrd.read_bytes()])]
    assert (widget._width, widget._height) == (900, "auto")


def test_the_page_needs_no_internet(run: RunResult) -> None:
    """The viewer's program travels inside the widget, not by an address."""
    widget = echogrid.show(run)
    program = str(widget._esm)
    assert not program.startswith("http")
    assert len(program) > 10_000_000


def test_a_run_without_a_recording_or_a_missing_file_gets_one_line(tmp_path: Path) -> None:
    config = load_config(settings=["grid.resolution_m=0.1"])
    without = map_session(ROOM, config, rrd=None, export=None)
    with pytest.raises(BadInput, match="wrote no recording"):
        echogrid.show(without)
    with pytest.raises(BadInput, match=r"none\.rrd: No such file") as error:
        echogrid.show(tmp_path / "none.rrd")
    assert "\n" not in str(error.value)


def test_without_the_extra_one_line_says_what_to_install(
    run: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun_notebook", None)
    with pytest.raises(BadInput, match="pip install rerun-notebook==") as error:
        echogrid.show(run)
    assert "\n" not in str(error.value)


def test_the_extra_is_of_the_viewers_own_version() -> None:
    """The page and the recording must speak the same format."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    (viewer,) = (each for each in project["dependencies"] if each.startswith("rerun-sdk"))
    (extra,) = project["optional-dependencies"]["jupyter"]
    assert extra == viewer.replace("rerun-sdk", "rerun-notebook")
    assert extra in NEEDS_JUPYTER


def click(entity: str, position: list[float] | None, kind: str = "selection_change") -> str:
    """What the viewer's page sends."""
    item = {"type": "entity", "entity_path": entity, "position": position}
    return json.dumps({"type": kind, "application_id": "echogrid", "items": [item]})


def test_a_click_on_a_cell_asks_why_it_is_so(run: RunResult) -> None:
    """In the viewer's plane y runs down."""
    widget = echogrid.show(run, session=ROOM)
    viewer, below = widget.children
    for callback in viewer._raw_event_callbacks:
        callback(click("/map/layers/ping/merged/t00_00", [2.21, -0.21, 0.0]))
    (answer,) = below.outputs
    assert "## Why is this cell so?" in answer["data"]["text/markdown"]
    assert "The cell at (2.21, 0.21) m" in answer["data"]["text/markdown"]
    for callback in viewer._raw_event_callbacks:
        callback(click("/map/layers/ping/merged/t00_00", [99.0, 0.0, 0.0]))
    assert "outside the grid" in below.outputs[0]["data"]["text/markdown"]


def test_only_a_click_on_a_map_asks(run: RunResult) -> None:
    assert clicked_m(click("/legend/swatches", [1.0, 1.0, 0.0])) is None
    assert clicked_m(click("/map/layers/ping", None)) is None
    assert clicked_m(click("/map/layers/ping", [1.0, 2.0, 0.0], kind="time_update")) is None
    assert run.rrd is not None
    assert config_of(run.rrd).grid.resolution_m == 0.1
