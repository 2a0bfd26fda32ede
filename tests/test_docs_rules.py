"""The page about update rules describes what the program does now, and its pictures are there."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

from mapping.update_rules import UPDATE_RULES

DOCS = Path(__file__).resolve().parent.parent / "docs"


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    path = DOCS / "make_rule_pictures.py"
    spec = importlib.util.spec_from_file_location("make_rule_pictures", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_numbers_are_those_of_the_rules(maker: ModuleType) -> None:
    page = (DOCS / "rules.md").read_text("utf-8")
    for name, table in maker.TABLES.items():
        assert maker.BEGIN.format(name) in page
        assert table() in page, f"{name}: python docs/make_rule_pictures.py"
    assert maker.with_numbers(page) == page


def test_every_rule_is_described(maker: ModuleType) -> None:
    page = (DOCS / "rules.md").read_text("utf-8")
    for rule in UPDATE_RULES:
        assert page.count(f"`{rule}`") >= 3  # in each table
    assert set(maker.RULES) >= {"binary", "count", "sum", "bayes", "odds", "dempster-shafer"}


def test_the_worked_cell_follows_bayes_by_hand(maker: ModuleType) -> None:
    temp = maker.reading(maker.HIT_M)
    row, col = maker.GRID.cells_of(np.array([maker.OBSTACLE_M]))[0]
    p = float(temp.probability[row - temp.window.row0, col - temp.window.col0])
    for times in maker.TIMES:
        odds = (p / (1 - p)) ** times
        _, found = maker.at(maker.after("bayes", [maker.HIT_M] * times), maker.OBSTACLE_M)
        assert found == pytest.approx(odds / (1 + odds), abs=1e-6)
        value, _ = maker.at(maker.after("count", [maker.HIT_M] * times), maker.OBSTACLE_M)
        assert value == times


def test_a_page_without_its_marks_is_not_written(maker: ModuleType) -> None:
    with pytest.raises(SystemExit, match="lacks the mark"):
        maker.with_numbers("# no marks here\n")


def test_the_pictures_are_there_and_small() -> None:
    page = (DOCS / "rules.md").read_text("utf-8")
    named = re.findall(r"\]\((images/[^)]+)\)", page)
    assert len(named) == 4
    for name in named:
        assert (DOCS / name).stat().st_size < 150_000
        with Image.open(DOCS / name) as picture:
            assert picture.width >= 600
