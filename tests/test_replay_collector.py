"""What a run comes to at its end, and anything of it as JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mapping.config import load_config
from mapping.pipeline import build_maps
from recorder.messages import Message
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS
from replay.collector import Collector
from replay.json_values import json_value


@pytest.fixture(scope="module")
def messages() -> list[Message]:
    return [message for _, message in simulate(ROOMS["room"], duration_s=20.0, seed=3)]


def collected(messages: list[Message], *settings: str) -> Collector:
    collector = Collector()
    for artifact in build_maps(messages, load_config((), ["grid.resolution_m=0.04", *settings])):
        collector(artifact)
    return collector


def test_what_was_found_on_the_way_is_no_result(messages: list[Message]) -> None:
    plain = collected(messages)
    staged = collected(messages, "rerun.stages_every=100")
    assert list(plain.snapshots) == list(staged.snapshots) == ["ping", "dirrs", "fused"]
    assert all(snapshot.final for snapshot in staged.snapshots.values())
    lines = [(s.layer, s.source, s.start_m, s.end_m) for s in plain.segments]
    assert {source for _, source, _, _ in lines} == {"grid", "raw"}
    assert [(s.layer, s.source, s.start_m, s.end_m) for s in staged.segments] == lines
    borders = [(b.layer, b.number, b.cells.tolist()) for b in plain.borders]
    assert borders
    assert [(b.layer, b.number, b.cells.tolist()) for b in staged.borders] == borders
    assert [p.layer for p in staged.points] == ["ping", "dirrs"]
    assert staged.finished == plain.finished is not None


def test_a_run_that_has_not_ended_has_no_counts(messages: list[Message]) -> None:
    collector = Collector()
    for artifact, _ in zip(build_maps(messages, load_config()), range(4), strict=False):
        collector(artifact)
    assert collector.finished is None
    assert collector.snapshots == {}


@dataclass(frozen=True)
class Pair:
    one: object
    other: object


def test_anything_can_be_written_as_json() -> None:
    value = Pair(
        {"a": (1, True, None), 2: Path("x") / "y"},
        [
            np.array([[1.5, math.inf]]),
            math.nan,
            np.float64(-math.inf),
            Pair("text", 1j),
            np.int64(3),
            np.bool_(True),
            np.float32(0.5),
        ],
    )
    assert json.loads(json.dumps(json_value(value), allow_nan=False)) == {
        "one": {"a": [1, True, None], "2": str(Path("x") / "y")},
        "other": [[[1.5, "inf"]], "nan", "-inf", {"one": "text", "other": "1j"}, 3, True, 0.5],
    }
