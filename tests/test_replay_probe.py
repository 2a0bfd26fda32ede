"""Watched cells in words, in the recording and on the command line; predicted ranges too."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from rerun.chunk import RrdReader

from echogrid import main
from mapping.artifacts import Artifact, MergedGrid
from mapping.beams import Beam
from mapping.config import MappingConfig, load_config
from mapping.pipeline import build_maps
from mapping.prediction import RangePredictor
from mapping.probing import BEHIND, BESIDE, EMPTY, OBSTACLE, CellProbe, Touch
from recorder.session import read_session
from replay import probe_text
from replay.mapping_run import RunResult, map_session
from replay.rrd import layout
from replay.rrd.reader import read_rrd

ROOM = ROOT / "logs" / "room.mcap"
WALL = (2.21, 0.21)  # on the right wall of the room, which both sensors saw
SETTING = "grid.resolution_m=0.02"

Run = tuple[RunResult, Path]


def config(*more: str) -> MappingConfig:
    return load_config(settings=[SETTING, *more])


@pytest.fixture(scope="module")
def artifacts() -> list[Artifact]:
    return list(build_maps(read_session(ROOM).messages(), config()))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    path = tmp_path_factory.mktemp("probe") / "room.rrd"
    return map_session(ROOM, config(), rrd=path, export=None, probes=[WALL, (0.0, 0.0)]), path


def rows(path: Path, entity: str, component: str) -> list[tuple[int, object]]:
    """Every row of a component, as step and value."""
    found = []
    for chunk in RrdReader(path).store().stream().filter(content=entity):
        batch = chunk.to_record_batch()
        if component in batch.schema.names and "step" in batch.schema.names:
            steps = batch.column("step").to_pylist()
            found += [
                (step, value[0])
                for step, value in zip(steps, batch.column(component).to_pylist(), strict=True)
                if value
            ]
    return sorted(found, key=lambda row: row[0])


def touch(zone: str, **changes: float) -> Touch:
    values = {"range_m": 0.5, "distance_m": 0.51, "before": 0.5, "after": 0.75, **changes}
    return Touch(reading=7, t_ns=0, layer="ping", sensor="ping", zone=zone, evidence=0.6, **values)


def test_a_touch_as_text() -> None:
    assert probe_text.touch_text(touch(OBSTACLE)) == (
        "reading 7, ping measured 0.500 m: the cell, 0.510 m away, lies where the obstacle may be; "
        "50.0 % → 75.0 %"
    )
    assert "nothing: the cell" in probe_text.touch_text(touch(EMPTY, range_m=math.inf))
    assert probe_text.touch_text(touch(EMPTY, after=0.5)).endswith("it stays at 50.0 %")
    behind = probe_text.touch_text(touch(BEHIND, before=math.nan, after=math.nan))
    assert behind.endswith("behind the obstacle, so the reading is no evidence for it")
    assert "beside the beam" in probe_text.touch_text(touch(BESIDE))


@pytest.mark.parametrize(
    ("belief", "word"),
    [(1.0, "black"), (0.8, "black"), (0.79, "dark grey"), (0.5, "grey"), (0.3, "light grey"),
     (0.1, "white"), (0.0, "white")],
)  # fmt: skip
def test_a_belief_has_the_colour_that_the_map_shows(belief: float, word: str) -> None:
    probe = CellProbe((0.0, 0.0))
    probe.beliefs["ping"] = belief
    assert probe_text.shade_name(probe, "ping").startswith("blue-grey")
    probe.observed.add("ping")
    assert probe_text.shade_name(probe, "ping") == word


def test_why_is_this_cell_black(run: Run) -> None:
    """The answer counts every reading, and its table is that of the largest effects."""
    probe = run[0].probes[0]
    lines = probe_text.explanation_lines(probe, ("ping", "dirrs", "fused"))
    assert lines[0].startswith("why is the cell at (2.21, 0.21) m (row ")
    assert lines[0].endswith(" black?")
    of_ping = [t for t in probe.touches if t.layer == "ping"]
    ping = next(line for line in lines if line.startswith("ping: "))
    assert f"{len(of_ping)} readings reached it" in ping
    assert lines[lines.index(ping) + 1] == f"  the 8 that moved it most, of {len(of_ping)}:"
    first_row = lines[lines.index(ping) + 3].split()
    largest = max(of_ping, key=lambda t: abs(t.effect))
    assert first_row[:2] == [str(largest.reading), "ping"]
    assert f"{100 * largest.effect:+.1f}" in first_row  # and then what moved it
    assert any(line.startswith("fused: ") and "black" in line for line in lines)


def test_what_nothing_reached_is_reported_so(run: Run) -> None:
    probe = CellProbe((0.0, 0.0))
    output = "\n".join(probe_text.explanation_lines(probe, ("ping", "fused")))
    assert "blue-grey (never seen)?" in output
    assert "ping: no reading reached it" in output
    assert "fused: not made yet" in output


def test_the_plot_of_a_cell_is_its_belief_at_every_step(
    run: Run, artifacts: list[Artifact]
) -> None:
    result, path = run
    cell = result.probes[0].cell
    expected, belief = {}, math.nan
    for step, artifact in enumerate(artifacts):
        if isinstance(artifact, MergedGrid) and artifact.layer == "ping":
            row, col = cell[0] - artifact.window.row0, cell[1] - artifact.window.col0
            if 0 <= row < artifact.window.rows and 0 <= col < artifact.window.cols:
                belief = 100 * float(artifact.probability[row, col])
            if not math.isnan(belief):
                expected[step] = belief
    plotted = dict(rows(path, layout.probe_belief(0, "ping"), "Scalars:scalars"))
    assert plotted.pop(0, 50.0) == 50.0  # what it was before the first
    assert {s: v for s, v in plotted.items() if s <= max(expected)} == expected
    assert len(set(expected.values())) > 5


def test_every_reading_that_reached_the_cell_is_listed_at_its_own_step(
    run: Run, artifacts: list[Artifact]
) -> None:
    result, path = run
    step_of = {a.beam.number: s for s, a in enumerate(artifacts) if isinstance(a, MergedGrid)}
    for number, probe in enumerate(result.probes):
        expected = [(step_of[t.reading], probe_text.touch_text(t)) for t in probe.touches]
        assert rows(path, layout.probe_log(number), "TextLog:text") == expected
    assert len(result.probes[0].touches) > 50
    last = rows(path, layout.probe_story(0), "TextDocument:text")[-1]
    assert last[0] == len(artifacts) - 1
    assert "| reading | sensor | range |" in str(last[1])
    count = len(result.probes[0].touches)
    assert f"the 8 that moved it most, of {count}, so far:" in str(last[1])


def test_the_text_of_a_step_explains_what_it_did_to_the_cell(
    run: Run, artifacts: list[Artifact]
) -> None:
    result, path = run
    texts = dict(rows(path, layout.EXPLANATION, "TextDocument:text"))
    step_of = {a.beam.number: s for s, a in enumerate(artifacts) if isinstance(a, MergedGrid)}
    first = result.probes[0].touches[0]
    assert f"**Your cell at (2.21, 0.21) m**: {probe_text.touch_text(first)}." in str(
        texts[step_of[first.reading]]
    )
    untouched = set(step_of) - {t.reading for probe in result.probes for t in probe.touches}
    assert untouched
    assert not any("Your cell" in str(texts[step_of[number]]) for number in untouched)


def test_readings_that_are_not_shown_still_count_for_the_cell(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "few.rrd"
    few = map_session(
        ROOM, config("rerun.every=10"), rrd=path, export=None, probes=[WALL, (0.0, 0.0)]
    )
    assert few.probes[0].touches == run[0].probes[0].touches
    assert len(rows(path, layout.probe_log(0), "TextLog:text")) == len(few.probes[0].touches)


def test_predicted_ranges_are_those_of_the_map_before_the_reading(
    run: Run, artifacts: list[Artifact]
) -> None:
    predictor = RangePredictor(config().borders.threshold)
    expected: dict[str, list[tuple[int, float]]] = {}
    texts = dict(rows(run[1], layout.EXPLANATION, "TextDocument:text"))
    for step, artifact in enumerate(artifacts):
        predictor(artifact)
        if isinstance(artifact, Beam):
            (predicted,) = predictor.ranges_m(artifact)
            expected.setdefault(artifact.sensor, []).append((step, predicted))
            shown = f"**{predicted:.3f} m**" if np.isfinite(predicted) else "**nothing**"
            assert f"would have predicted {shown}" in str(texts[step])
    for sensor, values in expected.items():
        exact = rows(run[1], layout.predicted_range(sensor), "numbers")
        assert exact == values
        plotted = [v for _, v in rows(run[1], layout.predicted_range(sensor), "Scalars:scalars")]
        np.testing.assert_array_equal(
            plotted, [v if math.isfinite(v) else math.nan for _, v in values]
        )
    of_ping = np.array([v for _, v in expected["ping"]])
    assert np.isinf(of_ping[0])
    assert np.isfinite(of_ping).mean() > 0.5


def test_a_map_that_knows_its_room_predicts_what_is_measured(artifacts: list[Artifact]) -> None:
    """Of the infrared, whose beams are narrow: in the later half most ranges are as predicted."""
    predictor = RangePredictor(0.55)
    gaps = []
    for artifact in artifacts:
        predictor(artifact)
        if isinstance(artifact, Beam) and artifact.sensor == "dirrs":
            (predicted,) = predictor.ranges_m(artifact)
            if np.isfinite(predicted) and artifact.saw_something[0]:
                gaps.append(abs(predicted - artifact.ranges_m[0]) / artifact.ranges_m[0])
    assert len(gaps) > 50
    assert np.median(gaps[len(gaps) // 2 :]) < 0.1


def test_the_recording_is_read_as_before(run: Run, artifacts: list[Artifact]) -> None:
    recording = read_rrd(run[1])
    assert len(recording.steps) == len(artifacts)
    final = run[0].snapshots[0].layer
    np.testing.assert_array_equal(recording.grid(final.name), final.values)


def test_the_command_answers_and_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = ["map", str(ROOM), "--set", "grid.resolution_m=0.05"]
    assert main([*common, "-o", "-", "--probe", "2.21,0.21", "--probe", "-0.1,0"]) == 0
    out = capsys.readouterr().out
    assert "why is the cell at (2.21, 0.21) m" in out
    assert "why is the cell at (-0.1, 0) m" in out
    rrd = tmp_path / "no.rrd"
    assert main([*common, "-o", str(rrd), "--export", str(tmp_path / "x"), "--probe", "99,0"]) == 2
    assert main([*common, "-o", str(rrd), "--probe", "here"]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 2
    assert "--probe 99,0 is outside the grid, which covers x " in errors[0]
    assert "'here' is not x,y in metres" in errors[1]
    assert list(tmp_path.iterdir()) == []
