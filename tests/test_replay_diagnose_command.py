"""The command ``diagnose``: text, JSON, page, the configuration that mends, before and after."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from mapping.config import load_config
from mapping.diagnosis.causes.interface import Plot
from recorder.cli.simulate import simulate
from replay.cli.diagnose import diagnose
from replay.diagnosis.page import svg, ticks


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("diagnose") / "late.mcap"
    asked = ["room", "-o", str(file), "--duration", "100", "--pose-delay", "0.15", "--quiet"]
    assert CliRunner().invoke(simulate, asked, standalone_mode=False).exit_code == 0
    return file


def test_a_bad_session_is_mended_by_the_file_that_it_writes(session: Path, tmp_path: Path) -> None:
    fix, page = tmp_path / "fix.toml", tmp_path / "page.html"
    run = CliRunner().invoke(
        diagnose, [str(session), "--fix", str(fix), "-o", str(page)], standalone_mode=False
    )
    assert run.return_value == 1
    assert "1. the poses come 1" in run.output
    assert "set pose.offset_s=-0.1" in run.output
    mended = load_config([fix])
    assert mended.pose.offset_s == pytest.approx(-0.15, abs=0.01)
    text = page.read_text("utf-8")
    assert "<svg" in text
    assert "pose.offset_s=-0.1" in text
    again = CliRunner().invoke(
        diagnose, [str(session), "--config", str(fix), "--json"], standalone_mode=False
    )
    assert again.return_value == 0
    assert json.loads(again.stdout)["suspects"] == []


def test_outputs_are_checked_before_the_work(session: Path, tmp_path: Path) -> None:
    for asked, why in (
        (["--fix", str(tmp_path / "fix.txt")], "must end in .toml"),
        (["-o", str(tmp_path / "page.pdf")], "must end in .html"),
    ):
        run = CliRunner().invoke(diagnose, [str(session), *asked], standalone_mode=False)
        assert why in str(run.exception)
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-0.31, 0.27), (12.0, 4000.0)])
def test_axes_have_a_few_round_numbers(low: float, high: float) -> None:
    found = ticks(low, high)
    assert 3 <= len(found) <= 8
    assert low <= found[0] <= found[-1] <= high
    assert np.ptp(np.diff(found)) == pytest.approx(0.0, abs=1e-9 * (high - low))


def test_a_plot_shows_its_points_and_escapes_its_title() -> None:
    points = np.column_stack([np.arange(50.0), np.sin(np.arange(50.0))])
    drawn = svg(Plot("a < b", "x", "y", points=points, line=points, mark=25.0))
    assert drawn.count("<circle") == 50
    assert "a &lt; b" in drawn
    assert "polyline" in drawn
    assert not any(math.isnan(float(v)) for v in drawn.split('cx="')[1].split('"')[:1])
    assert svg(Plot("empty", "x", "y")) == ""
