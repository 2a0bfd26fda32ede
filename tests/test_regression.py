"""The small sessions in logs/ become the same maps as ever, cell by cell.

``UPDATE_GOLDEN=1`` writes the expected maps anew, after a change that is meant.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from numpy.typing import NDArray

from mapping.artifacts import Snapshot
from mapping.config import load_config
from mapping.pipeline import build_maps
from recorder.messages import Pose, Range
from recorder.session import read_session
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room

GOLDEN = Path(__file__).parent / "golden"
SESSIONS = ("room", "l-room")
ATOL = 1e-4

Arrays = dict[str, NDArray[np.float32]]


def maps_of(name: str) -> Arrays:
    """The final values of each layer, and the origin of the grid."""
    session = read_session(ROOT / "logs" / f"{name}.mcap")
    assert session.damage == ()
    config = load_config(settings=["grid.resolution_m=0.02"])
    artifacts = build_maps(session.messages(), config)
    layers = [a.layer for a in artifacts if isinstance(a, Snapshot) and a.final]
    arrays = {layer.name: layer.values for layer in layers}
    arrays["origin"] = np.array(layers[0].geometry.origin_m, np.float32)
    return arrays


def differences(found: Arrays, golden: Arrays) -> list[str]:
    """A line for each layer that differs; empty where all agree."""
    lines = []
    for name in sorted(set(found) | set(golden)):
        if name not in found or name not in golden:
            lines.append(f"layer {name}: only in {'golden' if name in golden else 'found'}")
        elif found[name].shape != golden[name].shape:
            lines.append(f"layer {name}: shape {found[name].shape}, was {golden[name].shape}")
        else:
            lines += _cell_differences(name, found[name], golden[name])
    return lines


def _cell_differences(
    name: str, found: NDArray[np.float32], golden: NDArray[np.float32]
) -> list[str]:
    same = np.isclose(found, golden, rtol=0, atol=ATOL, equal_nan=True)
    if same.all():
        return []
    # A NaN on one side only is the worst that can be: it must not hide behind a comparison.
    away = np.where(same, 0.0, np.nan_to_num(np.abs(found - golden), nan=np.inf))
    worst = np.unravel_index(int(np.argmax(away)), away.shape)
    place = ", ".join(f"{word} {i}" for word, i in zip(("row", "col"), worst, strict=False))
    return [
        f"layer {name}: {np.count_nonzero(~same)} of {same.size} cells differ; worst {place}: "
        f"{found[worst]:.6g}, was {golden[worst]:.6g}"
    ]


@pytest.mark.parametrize("name", SESSIONS)
def test_maps_are_the_golden_ones(name: str) -> None:
    found = maps_of(name)
    file = GOLDEN / f"{name}.npz"
    if os.environ.get("UPDATE_GOLDEN") == "1":
        np.savez_compressed(file, **found)  # type: ignore[arg-type]
    with np.load(file) as stored:
        golden = {key: stored[key] for key in stored.files}
    assert set(golden) == {"ping", "dirrs", "fused", "origin"}
    assert all(array.dtype == np.float32 for array in golden.values())
    lines = differences(found, golden)
    assert not lines, "\n".join([f"{name} (UPDATE_GOLDEN=1 accepts):", *lines])


def test_a_changed_cell_is_named() -> None:
    with np.load(GOLDEN / "room.npz") as stored:
        golden = {key: stored[key] for key in stored.files}
    changed = {key: array.copy() for key, array in golden.items()}
    assert differences(changed, golden) == []
    row, col = 7, 11
    changed["ping"][row, col] += 0.25
    changed["ping"][row + 1, col] += 0.01
    changed["ping"][row + 2, col] += ATOL / 10
    (line,) = differences(changed, golden)
    size = golden["ping"].size
    before, after = golden["ping"][row, col], changed["ping"][row, col]
    assert line == (
        f"layer ping: 2 of {size} cells differ; worst row 7, col 11: {after:.6g}, was {before:.6g}"
    )
    changed["ping"][3, 4] = np.nan
    assert "3 of" in differences(changed, golden)[0]
    assert "row 3, col 4: nan" in differences(changed, golden)[0]
    del changed["dirrs"]
    assert "layer dirrs: only in golden" in differences(changed, golden)


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
