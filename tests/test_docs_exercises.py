"""The exercises: solutions get all points, what is handed out does not, and the ghost is one."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT

from mapping.update_rules import UPDATE_RULES
from recorder.simulator.echoes import cast
from recorder.simulator.rooms import ROOMS

FOLDER = ROOT / "docs" / "exercises"


@pytest.fixture(scope="module")
def marker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("mark", FOLDER / "mark.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["mark"] = module
    spec.loader.exec_module(module)
    return module


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("[1-9]-*") if path.suffix in (".py", ".toml"))


def points(marker: ModuleType, answer: Path) -> tuple[int, int]:
    rules = dict(UPDATE_RULES)
    try:
        criteria = marker.mark(int(answer.name[0]), answer)
    finally:
        for name in set(UPDATE_RULES) - set(rules):
            del UPDATE_RULES[name]
    return sum(c.points for c in criteria if c.met), sum(c.points for c in criteria)


@pytest.mark.parametrize("answer", files(FOLDER / "solutions"), ids=lambda path: path.name)
def test_solutions_get_all_points(marker: ModuleType, answer: Path) -> None:
    assert points(marker, answer) == (10, 10)


@pytest.mark.parametrize("answer", files(FOLDER), ids=lambda path: path.name)
def test_what_is_handed_out_does_not(marker: ModuleType, answer: Path) -> None:
    won, most = points(marker, answer)
    assert won < 7
    assert most <= 10


def test_each_has_a_page_a_beginning_and_a_solution(marker: ModuleType) -> None:
    pages = sorted(path.stem for path in FOLDER.glob("[1-9]-*.md"))
    assert [int(name[0]) for name in pages] == sorted(marker.EXERCISES)
    assert [path.stem for path in files(FOLDER)] == pages
    assert [path.stem for path in files(FOLDER / "solutions")] == pages


def test_the_ghost_is_drawn_by_a_wall_at_the_edge_of_the_beam(marker: ModuleType) -> None:
    """As the solution has it: where the robot starts, that wall is as far as was measured."""
    room = ROOMS[marker.GHOST_ROOM]
    start, towards = room.route_m[0], room.route_m[1]
    heading = np.arctan2(*(towards - start)[::-1])
    edge = heading - np.radians(19.0)
    at = start + 0.044 * np.array([np.cos(heading), np.sin(heading)])
    ahead_m, edge_m = cast(room.walls_m, np.array([at, at]), np.array([heading, edge])).distance_m
    assert edge_m == pytest.approx(2.05, abs=0.05)
    assert ahead_m < edge_m - 0.15
