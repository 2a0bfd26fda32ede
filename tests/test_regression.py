"""The small sessions in logs/ become the same maps, borders and lines as ever.

The maps in golden/ are compared by the project's own pytest plugin. ``pytest --update-golden``
writes them anew, after a change that is meant.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from recorder.messages import Pose, Range
from recorder.session import read_session
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room
from replay.diff.comparing import report
from replay.diff.layers import MapLayer, Source, value_layer
from replay.diff.sources.arrays import read_npz
from replay.pytest_plugin import SessionMapper

GOLDEN = Path(__file__).parent / "golden"
SESSIONS = ("room", "l-room")
SETTINGS = ("grid.resolution_m=0.02",)
ATOL = 1e-4


@pytest.mark.parametrize("name", SESSIONS)
def test_maps_are_the_golden_ones(name: str, session_map: SessionMapper) -> None:
    made = session_map(f"logs/{name}.mcap", settings=SETTINGS)
    assert set(made.layers) == {"ping", "dirrs", "fused"}
    assert all(layer.values.dtype == np.float32 for layer in made.layers.values())
    assert all(layer.lines and layer.borders for layer in made.layers.values())
    made.matches(GOLDEN / f"{name}.npz", atol=ATOL)


def test_the_chapters_own_choices_give_the_golden_map(session_map: SessionMapper) -> None:
    made = session_map("logs/room.mcap", settings=["grid.resolution_m=0.04"], preset="chapter")
    made.matches(GOLDEN / "room-chapter.npz", atol=ATOL)


def test_a_golden_map_holds_all_that_can_go_wrong() -> None:
    """A cell, a line or a border that changes in a golden map is seen."""
    golden = read_npz(GOLDEN / "room.npz")
    assert not report(golden, golden).differs
    for name, layer in golden.layers.items():
        assert layer.values is not None
        values = layer.values.copy()
        values[7, 11] += 1e-6
        changed = value_layer(name, layer.kind, layer.geometry, values)
        compared = report(golden, _with(golden, name, changed))
        (found,) = [each for each in compared.layers if each.cells.differ]
        assert found.name == name
        assert found.cells.differ == 1
        assert (found.cells.worst[0].row, found.cells.worst[0].col) == (7, 11)
        for lost in ("lines", "borders"):
            fewer = getattr(layer, lost)[1:]
            kept = {"lines": layer.lines, "borders": layer.borders, lost: fewer}
            changed = value_layer(name, layer.kind, layer.geometry, layer.values, **kept)
            assert report(golden, _with(golden, name, changed)).differs


def _with(golden: Source, name: str, layer: MapLayer) -> Source:
    return replace(golden, layers={**golden.layers, name: layer})


@pytest.mark.parametrize(("name", "seed"), [("room", 1), ("l-room", 2)])
def test_logs_are_what_the_simulator_makes(name: str, seed: int) -> None:
    file = ROOT / "logs" / f"{name}.mcap"
    assert file.stat().st_size < 150_000
    stored = read_session(file).records
    fresh = list(simulate(load_room(name), duration_s=20.0, seed=seed))
    assert [(r.log_ns, type(r.message), r.message.t_ns) for r in stored] == [
        (log_ns, type(message), message.t_ns) for log_ns, message in fresh
    ]
    readings = 0
    for record, (_, message) in zip(stored, fresh, strict=True):
        if isinstance(message, Range):
            assert isinstance(record.message, Range)
            assert record.message.sensor == message.sensor
            assert record.message.range_m == pytest.approx(message.range_m, abs=1e-6)
            readings += 1
        elif isinstance(message, Pose):
            assert isinstance(record.message, Pose)
            was, now = record.message.world_from_base, message.world_from_base
            assert (was.x_m, was.y_m) == pytest.approx((now.x_m, now.y_m), abs=1e-6)
    assert readings > 500
