"""Marks an answer to one of the exercises: ``python docs/exercises/mark.py 1 my_rule.py``.

Each exercise is a function from an answer's file to criteria, named in ``EXERCISES``. Those that
judge a map take another drive through the same room (another seed), so that an answer that fits one
session alone does not win.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mapping.artifacts import TempGrid
from mapping.config import MappingConfig, load_config
from mapping.laws import check_plugin
from mapping.laws.made_readings import one_spot_readings
from mapping.plugins import load_plugin
from mapping.scoring.layers import LayerScore
from mapping.update_rules import UPDATE_RULES, UpdateRule
from recorder.errors import BadInput, EchogridError
from recorder.session import SessionWriter
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room
from recorder.truth import WALLS, WALLS_TYPE, walls_to_geojson
from replay.mapping_run import map_session
from replay.scoring.judging import judge_map

GHOST_M = (2.1, 1.45)
GHOST_ROOM, GHOST_SEED = "l-room", 5
UNSEEN_ROOM, UNSEEN_SEED = "room", 1001


@dataclass(frozen=True, slots=True)
class Criterion:
    """One thing that an answer is marked by: what is asked, its points, and what was found."""

    asked: str
    points: int
    met: bool
    found: str


Marking = Callable[[Path, Path], Iterator[Criterion]]


def update_rule(answer: Path, folder: Path) -> Iterator[Criterion]:
    """1: log-odds that are added and held within 2: a wall that is taken away can vanish."""
    before = set(UPDATE_RULES)
    load_plugin(answer)
    names = sorted(set(UPDATE_RULES) - before)
    yield Criterion(
        "the file holds one update rule", 1, len(names) == 1, ", ".join(names) or "none"
    )
    if len(names) != 1:
        return
    rule = UPDATE_RULES[names[0]]
    broken = [each.law for each in check_plugin(answer) if each.broken is not None]
    yield Criterion("it keeps the laws (echogrid check)", 3, not broken, "; ".join(broken) or "all")
    hit, through = (_weakened(reading) for reading in one_spot_readings())
    once = float(hit.probability[hit.band][0])
    after = _belief(rule, [hit])
    yield Criterion(
        "one reading leaves its own probability", 2, abs(after - once) < 1e-6,
        f"a reading of {once:.3f} gives {after:.3f}",
    )  # fmt: skip
    surest, limit = _belief(rule, [hit] * 50), 1.0 / (1.0 + np.exp(-2.0))
    yield Criterion(
        "fifty readings leave it at log-odds 2", 2, abs(surest - limit) < 1e-6,
        f"probability {surest:.4f}, wanted {limit:.4f}",
    )  # fmt: skip
    freed = _belief(rule, [hit] * 50 + [through] * 3)
    yield Criterion(
        "three readings to the contrary free it again", 2, freed < 0.5, f"probability {freed:.3f}"
    )


def _weakened(reading: TempGrid) -> TempGrid:
    """Evidence of 0.7 rather than 0.95, of 0.3 rather than 0.05: less than the limit allows."""
    p = reading.probability
    return replace(reading, probability=0.5 + 0.2 * np.sign(p - 0.5))


def _belief(rule: UpdateRule, readings: list[TempGrid]) -> float:
    """The probability of the cell that the first reading hit, after all of them."""
    temp = readings[0]
    cells = {name: np.full(temp.probability.shape, value) for name, value in rule.start.items()}
    for reading in readings:
        rule.merge(cells, reading)
    return float(rule.probability(cells, 1.0)[temp.band][0])


def threshold(answer: Path, folder: Path) -> Iterator[Criterion]:
    """2: the threshold at which the sonar's borders give the walls best."""
    config = load_config([answer])
    yield _only(answer, {"borders": {"threshold"}})
    mine = _lines(_judged(folder, config)["ping"])
    best = max(
        _lines(_judged(folder, load_config(settings=[f"borders.threshold={value}"]))["ping"])
        for value in (0.7, 0.9, 0.95)
    )
    yield from _shares("the sonar's lines are nearly as good as any threshold gives", mine, best)


def two_sensors(answer: Path, folder: Path) -> Iterator[Criterion]:
    """3: weights of the two sensors, for a fused map that is less often wrong."""
    chapter = ["fusion.rule=weights", "sensors.*.update=bayes"]
    config = load_config([answer], chapter)
    yield _only(answer, {"fusion": {"rule", "weights"}})
    loss = _judged(folder, config)["fused"].cells.log_loss
    equal, angular = (
        _judged(folder, load_config(settings=[*chapter, f"fusion.weights={each}"]))[
            "fused"
        ].cells.log_loss
        for each in ("equal", "angular")
    )
    found = f"log-loss {loss:.3f}; equal weights {equal:.3f}, by angle {angular:.3f}"
    yield Criterion("better than equal weights", 4, loss < equal - 0.001, found)
    yield Criterion("better than weights by angle", 5, loss < angular - 0.001, found)


def split_and_merge(answer: Path, folder: Path) -> Iterator[Criterion]:
    """4: the keys of split-and-merge that give the walls from the infrared's raw points."""
    config = load_config([answer])
    keys = {"epsilon_m", "min_points", "min_length_m", "raw_gap_m", "merge", "order", "wrap"}
    yield _only(answer, {"segments": keys | {"method", "rms_m"}})
    mine = _lines(_judged(folder, config)["dirrs"], "raw")
    start = _lines(_judged(folder, load_config(settings=[
        "segments.epsilon_m=0.01", "segments.min_points=2", "segments.min_length_m=0.02",
    ]))["dirrs"], "raw")  # fmt: skip
    usual = _lines(_judged(folder, MappingConfig())["dirrs"], "raw")
    found = f"F1 {mine:.3f}; as handed out {start:.3f}, by default {usual:.3f}"
    yield Criterion("better than what was handed out", 4, mine > start, found)
    yield Criterion("at least 95 % of the default", 5, mine >= 0.95 * usual, found)


def ghost(answer: Path, folder: Path) -> Iterator[Criterion]:
    """5: which readings drew the ghost, and why they drew it there."""
    given = _table(answer)
    session = _drive(folder, GHOST_ROOM, GHOST_SEED, 60.0)
    probe = map_session(session, MappingConfig(), rrd=None, export=None, probes=[GHOST_M]).probes[0]
    strongest = {touch.reading: touch for touch in probe.strongest(8, "ping")}
    readings = given.get("readings", [])
    named = [each for each in readings if type(each) is int][:3] if type(readings) is list else []
    right = [each for each in named if each in strongest]
    yield Criterion(
        "three readings of the eight that moved the cell most", 5, len(set(right)) == 3,
        f"{len(set(right))} of {len(named)} are among them",
    )  # fmt: skip
    cause = str(given.get("cause", ""))
    yield Criterion("their cause", 3, cause == "wide", cause or "none given")
    ranges = sorted(touch.range_m for touch in strongest.values())
    low, high = ranges[0] - 0.05, ranges[-1] + 0.05
    range_m = given.get("range_m", 0.0)
    met = type(range_m) in (int, float) and low <= range_m <= high
    yield Criterion("about which range they measured", 2, met, f"{range_m} m")


def beat_the_default(answer: Path, folder: Path) -> Iterator[Criterion]:
    """6: any configuration, or a plugin with a configuration beside it, for a better fused map."""
    plugin = answer.with_suffix(".py")
    if plugin.exists():
        load_plugin(plugin)
    config = load_config([answer])
    mine, usual = (_judged(folder, each)["fused"] for each in (config, MappingConfig()))
    loss, before = mine.cells.log_loss, usual.cells.log_loss
    found = f"log-loss {loss:.4f}, default {before:.4f}"
    yield Criterion("no worse than the default", 3, loss <= before, found)
    yield Criterion("better by 3 %", 4, loss <= 0.97 * before, found)
    ghosts = f"{mine.cells.ghost_m2:.2f} square metres, default {usual.cells.ghost_m2:.2f}"
    yield Criterion(
        "without more ghosts", 3, mine.cells.ghost_m2 <= 1.05 * usual.cells.ghost_m2, ghosts
    )


EXERCISES: dict[int, Marking] = {
    1: update_rule, 2: threshold, 3: two_sensors, 4: split_and_merge, 5: ghost, 6: beat_the_default,
}  # fmt: skip


def _table(answer: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(answer.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise BadInput(f"{answer}: {error}") from None


def _only(answer: Path, allowed: dict[str, set[str]]) -> Criterion:
    given = _table(answer)
    others = [f"{section}.{key}" for section, keys in given.items() for key in keys
              if key not in allowed.get(section, set())]  # fmt: skip
    names = ", ".join(f"{section}.{key}" for section in allowed for key in sorted(allowed[section]))
    return Criterion(f"only {names} set", 1, not others, ", ".join(others) or "so it is")


def _drive(folder: Path, room: str, seed: int, duration_s: float) -> Path:
    """A simulated session with its walls, made once."""
    session = folder / f"{room}-{seed}.mcap"
    if not session.exists():
        place = load_room(room)
        with SessionWriter(session, metadata={"simulated": room, "seed": seed}) as file:
            file.attach(WALLS, WALLS_TYPE, walls_to_geojson(place.walls_m, place.name))
            for log_ns, message in simulate(place, duration_s=duration_s, seed=seed):
                file.write(message, log_ns=log_ns)
    return session


def _judged(folder: Path, config: MappingConfig) -> dict[str, LayerScore]:
    session = _drive(folder, UNSEEN_ROOM, UNSEEN_SEED, 60.0)
    scores = judge_map(session, config=config).scores
    return dict(scores)


def _lines(layer: LayerScore, source: str = "grid") -> float:
    """F1 of wall length within 5 cm: found walls and right lines weigh the same."""
    score = layer.lines_of(source)
    if score is None:
        return 0.0
    (shares,) = (each for each in score.within if each.tolerance_m == 0.05)
    found, right = np.nan_to_num([shares.completeness, shares.correctness])
    return float(2.0 * found * right / (found + right)) if found + right > 0.0 else 0.0


def _shares(asked: str, mine: float, best: float) -> Iterator[Criterion]:
    found = f"F1 {mine:.3f}, the best threshold {best:.3f}"
    yield Criterion(f"{asked}: 90 %", 4, mine >= 0.9 * best, found)
    yield Criterion(f"{asked}: 97 %", 5, mine >= 0.97 * best, found)


def mark(number: int, answer: Path) -> list[Criterion]:
    """All criteria of an exercise. Raises an EchogridError where the answer cannot be read."""
    if not answer.exists():
        raise BadInput(f"{answer}: no such file")
    with tempfile.TemporaryDirectory() as folder:
        return list(EXERCISES[number](answer, Path(folder)))


def main() -> int:
    """0: full marks; 1: not yet; 2: the answer cannot be read."""
    parser = argparse.ArgumentParser(description="Mark an answer to an exercise.")
    parser.add_argument("number", type=int, choices=sorted(EXERCISES), help="which exercise")
    parser.add_argument("answer", type=Path, help="the file with your answer")
    given = parser.parse_args()
    try:
        criteria = mark(given.number, given.answer)
    except EchogridError as error:
        print(f"mark: {error}", file=sys.stderr)
        return 2
    for each in criteria:
        print(f"{each.points if each.met else 0:>2} of {each.points}  {each.asked}: {each.found}")
    won, most = sum(each.points for each in criteria if each.met), 10
    print(f"{won} of {most} points")
    return 0 if won == most else 1


if __name__ == "__main__":
    sys.exit(main())
