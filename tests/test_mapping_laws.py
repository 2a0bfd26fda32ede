"""The laws hold for everything built in, and catch rules and models that are wrong."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.config import MappingConfig, ReportedSensor, resolve_sensor
from mapping.grid import GridGeometry
from mapping.laws import MODEL_LAWS, RULE_LAWS, check_model, check_plugin, check_rule
from mapping.laws.made_readings import random_reading
from mapping.plugins import load_plugin
from mapping.sensor_model import SENSOR_MODELS, SensorModel
from mapping.update_rules import UPDATE_RULES, UpdateRule, start
from recorder.errors import BadInput
from recorder.messages import Radiation

DOCS = Path(__file__).parent.parent / "docs" / "plugins.md"
QUICK_RULE_LAWS = [name for name in RULE_LAWS if not name.startswith("100,000")]


@pytest.fixture
def tables():
    """Plugins register themselves: leave the tables as they were."""
    models, rules = dict(SENSOR_MODELS), dict(UPDATE_RULES)
    yield
    for table, before in ((SENSOR_MODELS, models), (UPDATE_RULES, rules)):
        table.clear()
        table.update(before)


def broken(findings):
    return {finding.law: finding.broken for finding in findings if finding.broken}


# --- what is built in keeps them ---------------------------------------------------------------


@pytest.mark.parametrize("law", MODEL_LAWS)
@pytest.mark.parametrize("model", list(SENSOR_MODELS))
@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**32 - 1))
def test_every_model_keeps_every_law(model, law, seed):
    assert MODEL_LAWS[law](SENSOR_MODELS[model], np.random.default_rng(seed)) is None


@pytest.mark.parametrize("law", QUICK_RULE_LAWS)
@pytest.mark.parametrize("rule", list(UPDATE_RULES))
@settings(deadline=None, max_examples=8)
@given(seed=st.integers(0, 2**32 - 1))
def test_every_rule_keeps_every_law(rule, law, seed):
    assert RULE_LAWS[law](UPDATE_RULES[rule], np.random.default_rng(seed)) is None


@pytest.mark.parametrize("rule", ["binary", "count", "sum", "bayes", "odds"])
def test_the_law_of_one_spot(rule):
    law = RULE_LAWS["100,000 readings of one spot"]
    assert law(UPDATE_RULES[rule], np.random.default_rng(0)) is None


def test_random_readings_are_worth_trying():
    draw = np.random.default_rng(1)
    temps = [random_reading(draw, echo=bool(k % 3)) for k in range(30)]
    assert sum(temp.band.any() for temp in temps) >= 15
    assert sum(temp.free.any() for temp in temps) >= 20
    assert any(abs(temp.beam.world_from_sensor.heading_rad) > np.pi for temp in temps)


# --- what is wrong is caught, in a sentence ----------------------------------------------------


class TextbookBayes(UpdateRule):
    name = "textbook"
    start: ClassVar = {"belief": 0.5}

    def merge(self, cells, temp):
        t, f = temp.probability, cells["belief"]
        with np.errstate(invalid="ignore"):
            cells["belief"][:] = t * f / (t * f + (1 - t) * (1 - f))

    def values(self, cells):
        return cells["belief"]


class LastWord(TextbookBayes):
    name = "last-word"

    def merge(self, cells, temp):
        touched = temp.probability != 0.5
        cells["belief"][touched] = temp.probability[touched]


class Spills(TextbookBayes):
    name = "spills"

    def merge(self, cells, temp):
        cells["belief"] += 1e-3


class Backwards(UpdateRule):
    name = "backwards"
    start: ClassVar = {"score": 0.0}

    def merge(self, cells, temp):
        cells["score"] -= 2 * temp.probability - 1

    def values(self, cells):
        return cells["score"]

    def probability(self, cells, largest):
        return np.clip(0.5 + cells["score"] / 20, 0, 1)


class Unbounded(Backwards):
    name = "unbounded"

    def merge(self, cells, temp):
        cells["score"] += 2 * temp.probability - 1

    def probability(self, cells, largest):
        return 1 + cells["score"]


class Shared(UpdateRule):
    name = "shared"
    start: ClassVar = {"score": 0.0}

    def __init__(self):
        self.seen = 0

    def merge(self, cells, temp):
        self.seen += 1
        cells["score"][temp.band] += self.seen

    def values(self, cells):
        return cells["score"]


class Writes(TextbookBayes):
    name = "writes"

    def merge(self, cells, temp):
        temp.probability[:] = 0.5


@pytest.mark.parametrize(
    ("rule", "law", "words"),
    [
        (TextbookBayes(), "100,000 readings of one spot", "stuck at 1"),
        (LastWord(), "the order of readings does not matter", "order_matters = True"),
        (Spills(), "only covered cells change", "cells beside the beam changed"),
        (Spills(), "a reading that says nothing changes nothing", "cells changed"),
        (Backwards(), "evidence counts its own way", "occupied: the probability sank"),
        (Unbounded(), "values stay finite, probabilities within 0 and 1", "probabilities run from"),
        (Shared(), "a map keeps to itself", "two different maps"),
        (Writes(), "only covered cells change", "raised ValueError"),
    ],
)
def test_a_wrong_rule_is_found(rule, law, words):
    findings = broken(check_rule(rule))
    assert words in findings[law]
    assert all("\n" not in text for text in findings.values())


class OneSided(SensorModel):
    name = "one-sided"

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 0.7, 0.5 - 0.1 * (beam_cells.across_m > 0))


class Relative(SensorModel):
    name = "relative"

    def occupied(self, sensor, beam_cells):
        weight = beam_cells.rho_m / beam_cells.rho_m.max(initial=1e-9)
        return np.where(beam_cells.in_band, 0.5 + 0.4 * weight, 0.5 - 0.4 * weight)


class TooSure(SensorModel):
    name = "too-sure"

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 1.5, 0.4)


class UpsideDown(SensorModel):
    name = "upside-down"

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 0.4, 0.6)


class OneNumber(SensorModel):
    name = "one-number"

    def occupied(self, sensor, beam_cells):
        return 0.7


class BehindItself(SensorModel):
    name = "behind-itself"

    def band(self, sensor):
        return 1.5, 0.1

    def occupied(self, sensor, beam_cells):
        return np.full_like(beam_cells.rho_m, 0.5)


class Moody(SensorModel):
    """Gives something else each time that it is asked."""

    name = "moody"

    def __init__(self):
        self.calls = 0

    def occupied(self, sensor, beam_cells):
        self.calls += 1
        return np.where(beam_cells.in_band, 0.6 + 0.1 * (self.calls % 2), 0.4)


@pytest.mark.parametrize(
    ("model", "law", "words"),
    [
        (OneSided(), "the temp grid mirrors across the beam", "against"),
        (Relative(), "each cell is judged by itself", "among 20 cells"),
        (TooSure(), "every cell gets one probability", "1.5 for a cell"),
        (
            UpsideDown(),
            "the band speaks for the obstacle, the front against it",
            "0.6 in front of",
        ),
        (OneNumber(), "every cell gets one probability", "() probabilities for (200,) cells"),
        (BehindItself(), "the band lies at the range", "1.5 before"),
        (Moody(), "the temp grid turns with the beam", "cells differ"),
    ],
)
def test_a_wrong_model_is_found(model, law, words):
    findings = broken(check_model(model))
    assert words in findings[law]


# --- plugin files ------------------------------------------------------------------------------


def example_in_the_docs():
    text = DOCS.read_text(encoding="utf-8")
    found = re.search(r"<!-- my_rules.py -->\n```python\n(.*?)```", text, re.DOTALL)
    assert found is not None
    return found.group(1)


@pytest.mark.usefixtures("tables")
def test_the_worked_example_of_the_docs_keeps_the_laws_and_maps(tmp_path):
    file = tmp_path / "my_rules.py"
    file.write_text(example_in_the_docs(), encoding="utf-8")
    findings = check_plugin(file)
    assert broken(findings) == {}
    assert len(findings) == len(MODEL_LAWS) + len(RULE_LAWS)
    config = MappingConfig.model_validate(
        {"sensors": {"*": {"model": "cone", "update": "hit-share"}}}
    )
    sensor = resolve_sensor(ReportedSensor("ping", Radiation.ULTRASOUND), config, mounted=False)
    assert (sensor.model, sensor.update) == ("cone", "hit-share")
    grid = GridGeometry((-1.0, -1.0), 0.05, 40, 40)
    state = start(sensor.update, grid)
    draw = np.random.default_rng(0)
    for _ in range(20):
        state.merge(random_reading(draw))
    layer = state.layer("ping")
    assert layer.kind == "probability"
    assert layer.probability.min() < 0.5 < layer.probability.max()
    assert layer.probability[~layer.observed].tolist() == pytest.approx(
        [0.5] * int((~layer.observed).sum())
    )


def test_the_docs_name_every_law():
    text = DOCS.read_text(encoding="utf-8")
    for law in (*MODEL_LAWS, *RULE_LAWS):
        assert law in text


@pytest.mark.usefixtures("tables")
def test_loading_a_file_again_replaces_it(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(example_in_the_docs(), encoding="utf-8")
    load_plugin(file)
    first = UPDATE_RULES["hit-share"]
    plugin = load_plugin(file)
    assert UPDATE_RULES["hit-share"] is plugin.rules[0] is not first
    assert SENSOR_MODELS["cone"] is plugin.models[0]


RULE = "from mapping.update_rules import UpdateRule\nclass Mine(UpdateRule):\n"
MODEL = "from mapping.sensor_model import SensorModel\nclass Mine(SensorModel):\n"
METHODS = "    def merge(self, cells, temp): pass\n    def values(self, cells): return cells['a']\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = 1\n", "defines no class derived from SensorModel or UpdateRule"),
        ("def broken(:\n", r"line 1: invalid syntax"),
        ("import nothing_like_it\n", r"line 1: ModuleNotFoundError: No module named"),
        ("a = 1\nb = a / 0\n", r"line 2: ZeroDivisionError: division by zero"),
        (RULE + "    pass\n", "class Mine needs a name"),
        (RULE + "    name = 'bayes'\n", "takes the name 'bayes', which is built in"),
        (RULE + "    name = 'mine'\n" + METHODS, "class Mine needs start"),
        (RULE + "    name = 'mine'\n    start = {'a': 0.0}\n", "class Mine needs a method merge"),
        (MODEL + "    name = 'mine'\n", "class Mine needs a method occupied"),
        (MODEL + "    name = 'm'\n    def __init__(self): raise OSError('no\\nway')\n",
         r"Mine\(\) fails: OSError: no way"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_gets_one_line(tmp_path, text, words):
    file = tmp_path / "mine.py"
    file.write_text(text, encoding="utf-8")
    before = dict(SENSOR_MODELS), dict(UPDATE_RULES)
    with pytest.raises(BadInput, match=words) as raised:
        load_plugin(file)
    assert "\n" not in str(raised.value)
    assert str(raised.value).startswith(str(file))
    assert (dict(SENSOR_MODELS), dict(UPDATE_RULES)) == before


def test_a_file_that_is_not_there_or_not_python(tmp_path):
    with pytest.raises(BadInput, match="no such file"):
        load_plugin(tmp_path / "missing.py")
    (tmp_path / "rule.txt").write_text("x")
    with pytest.raises(BadInput, match=r"must end in \.py"):
        load_plugin(tmp_path / "rule.txt")
