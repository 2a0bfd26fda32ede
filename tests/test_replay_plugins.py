"""A model and a rule, a class each in one file, known wherever the built-in ones are known."""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from naive_placing import place

from echogrid import main
from mapping.artifacts import MergedGrid, Snapshot, Started, TempGrid
from mapping.config import MappingConfig, load_config, unused_keys
from mapping.pipeline import build_maps
from mapping.plugins import load_plugin
from mapping.sensor_model import SENSOR_MODELS, make_temp_grid
from mapping.update_rules import UPDATE_RULES
from recorder.errors import BadInput
from recorder.session import read_session
from replay.diff.layers import FREE, OCCUPIED, UNKNOWN, MapLayer
from replay.diff.sources.opening import open_map
from replay.rrd.reader import read_rrd

SESSION = Path(__file__).parent.parent / "logs" / "room.mcap"
PLUGIN = '''
import numpy as np

from mapping.sensor_model import SensorModel
from mapping.update_rules import UpdateRule


class Long(SensorModel):
    name = "long"

    class Parameters(SensorModel.Parameters):
        reach: float = 0.8

    def band(self, sensor):
        return 0.1, sensor.reach

    def occupied(self, sensor, beam_cells):
        return np.where(beam_cells.in_band, 0.7, 0.4)


class Score(UpdateRule):
    """Begins at 3, and its values are no probabilities."""

    name, kind, start = "score", "score", {"score": 3.0}

    class Parameters(UpdateRule.Parameters):
        step: float = 1.0

    def merge(self, cells, temp):
        change = self.parameters.step * np.sign(temp.probability - 0.5)
        cells["score"][:] = np.clip(cells["score"] + change, -7, 13)

    def values(self, cells):
        return cells["score"]

    def probability(self, cells, largest):
        return 1 / (1 + np.exp(3.0 - cells["score"]))
'''
CHOSEN = ("sensors.*.model=long", "sensors.*.update=score", "grid.resolution_m=0.05")
OPTIONS = [part for setting in CHOSEN for part in ("--set", setting)]


@pytest.fixture
def forgotten() -> Iterator[None]:
    """Afterwards nobody knows the plugin any more, as in another process."""
    before = dict(SENSOR_MODELS), dict(UPDATE_RULES)
    yield
    for table, known in zip((SENSOR_MODELS, UPDATE_RULES), before, strict=True):
        table.clear()
        table.update(known)


@pytest.fixture(scope="module")
def plugin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("plugin") / "mine.py"
    file.write_text(PLUGIN, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def mapped(plugin: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what ``map`` makes with the plugin; it is not known any more."""
    folder = tmp_path_factory.mktemp("mapped")
    before = dict(SENSOR_MODELS), dict(UPDATE_RULES)
    command = ["map", str(SESSION), "-o", str(folder / "map.rrd"), "--export", str(folder / "out")]
    assert main([*command, "--plugin", str(plugin), "--quiet", *OPTIONS]) == 0
    SENSOR_MODELS.clear(), UPDATE_RULES.clear()
    SENSOR_MODELS.update(before[0]), UPDATE_RULES.update(before[1])
    return folder


@pytest.fixture
def maps(plugin: Path, forgotten: None) -> dict[str, Snapshot]:
    load_plugin(plugin)
    config = load_config(settings=CHOSEN)
    artifacts = build_maps(read_session(SESSION).messages(), config)
    return {a.layer.name: a for a in artifacts if isinstance(a, Snapshot) and a.final}


def test_the_grid_holds_every_footprint(plugin: Path, forgotten: None) -> None:
    """A band that reaches 80 % behind the range is nowhere cut off by the grid."""
    load_plugin(plugin)
    config = load_config(settings=CHOSEN)
    sensors = place(read_session(SESSION).messages(), config).sensors
    assert sensors["ping"].own["reach"] == 0.8
    cut = compared = 0
    for artifact in build_maps(read_session(SESSION).messages(), config):
        if isinstance(artifact, Started):
            grid, more = artifact.geometry, 100
            x, y = grid.origin_m
            corner = (x - more * grid.resolution_m, y - more * grid.resolution_m)
            wide = replace(
                grid, origin_m=corner, rows=grid.rows + 2 * more, cols=grid.cols + 2 * more
            )
        elif isinstance(artifact, TempGrid):
            whole = make_temp_grid(artifact.beam, sensors[artifact.beam.sensor], wide)
            compared += 1
            cut += int(whole.band.sum() != artifact.band.sum())
    assert compared > 100
    assert cut == 0


@pytest.mark.usefixtures("forgotten")
def test_the_recording_and_the_export_hold_all_that_a_reader_needs(
    mapped: Path, maps: dict[str, Snapshot]
) -> None:
    UPDATE_RULES.pop("score")
    recording = read_rrd(mapped / "map.rrd")
    for name in ("ping", "dirrs"):
        true = maps[name].layer
        assert recording.kind_and_rule(name) == ("score", "score")
        assert recording.start_value(name) == 3.0
        assert np.array_equal(recording.grid(name), true.values)
        for source in (mapped / "map.rrd", mapped / "out" / f"{name}.npz", mapped / "out"):
            layer = open_map(source).layers[name]
            assert (layer.kind, layer.start) == ("score", 3.0)
            assert layer.values is not None
            assert np.array_equal(layer.values, true.values)
            assert np.array_equal(layer.probability, true.probability)
            assert_classes_of(layer, true.probability)


def assert_classes_of(layer: MapLayer, probability: np.ndarray) -> None:
    seen = np.asarray(layer.values) != 3.0
    assert (layer.classes[~seen] == UNKNOWN).all()
    assert np.array_equal(layer.classes == OCCUPIED, seen & (probability > np.float32(0.55)))
    assert np.array_equal(layer.classes == FREE, seen & (probability < np.float32(0.45)))
    assert {FREE, OCCUPIED} <= set(layer.classes.ravel().tolist())


def test_every_step_of_the_recording_has_the_values_that_it_had(
    plugin: Path, mapped: Path, forgotten: None
) -> None:
    load_plugin(plugin)
    config = load_config(settings=CHOSEN)
    after: list[np.ndarray] = []
    grid = np.zeros(0)
    for artifact in build_maps(read_session(SESSION).messages(), config):
        if isinstance(artifact, Started):
            grid = np.full(artifact.geometry.shape, 3.0, np.float32)
        elif isinstance(artifact, MergedGrid) and artifact.layer == "ping":
            grid[artifact.window.slices] = artifact.values
            after.append(grid.copy())
    UPDATE_RULES.pop("score")
    found = [values for _, values in read_rrd(mapped / "map.rrd").grids("ping")]
    steps, expected = changed(found), changed(after)
    assert len(steps) == len(expected) > 100
    assert all(np.array_equal(*pair) for pair in zip(steps, expected, strict=True))


def changed(grids: list[np.ndarray]) -> list[np.ndarray]:
    """Without those that are as the one before."""
    pairs = itertools.pairwise(grids)
    return grids[:1] + [now for before, now in pairs if not np.array_equal(before, now)]


def test_diff_needs_no_plugin(mapped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diff", str(mapped / "map.rrd"), str(mapped / "out")]) == 0
    assert "all" in capsys.readouterr().out
    picture = mapped / "diff.png"
    one = mapped / "out" / "ping.npz"
    assert main(["diff", str(one), str(mapped / "out" / "ping.yaml"), "-o", str(picture)]) == 0
    assert picture.stat().st_size > 0


@pytest.mark.usefixtures("forgotten")
def test_diff_maps_sessions_with_it(plugin: Path, mapped: Path) -> None:
    session = str(SESSION)
    assert main(["diff", session, str(mapped / "out"), "--plugin", str(plugin), *OPTIONS]) == 0
    other = [*OPTIONS, "--set", "sensors.*.step=0.5", "--quiet"]
    assert main(["diff", session, str(mapped / "out"), "--plugin", str(plugin), *other]) == 1


@pytest.mark.usefixtures("forgotten")
def test_compare_lists_it(plugin: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["map", str(SESSION), "-o", "-", "--plugin", str(plugin), *OPTIONS[-2:]]
    assert main([*command, "--compare", "sensors.*.update=count,score"]) == 0
    table = capsys.readouterr().out
    (row,) = (line for line in table.splitlines() if line.strip().startswith("score"))
    assert all(char.isdigit() for char in row.split()[1].replace(",", ""))
    assert "count knows no emptiness below zero" in table  # and score does
    step = ["--set", "sensors.*.update=score", "--compare", "sensors.*.step=0.5,2"]
    assert main([*command, *step]) == 0
    assert "step-0.5" in capsys.readouterr().out


@pytest.mark.usefixtures("forgotten")
def test_config_and_check_know_it(plugin: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "--plugin", str(plugin), "--set", "sensors.ping.step=2"]) == 0
    text = capsys.readouterr().out
    assert "step = 2.0" in text
    assert "# reach =    # long: reach (default 0.8)" in text
    assert "# step =    # score: step (default 1)" in text
    assert "regions, peak, fading, long" in text
    assert main(["check", str(plugin)]) == 0
    assert "BREAKS" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("sensors.ping.stepp=1", "unknown key sensors.ping.stepp; the nearest known one is step"),
        ("sensors.ping.step=big", "sensors.ping.step: input should be a valid number"),
        ("step=1", r"unknown key step; did you mean sensors\.\*\.step\?"),
    ],
)
@pytest.mark.usefixtures("forgotten")
def test_its_keys_are_checked_like_all_keys(plugin: Path, setting: str, words: str) -> None:
    load_plugin(plugin)
    with pytest.raises(BadInput, match=words) as raised:
        load_config(settings=[setting])
    assert "\n" not in str(raised.value)


def test_without_the_plugin_its_keys_are_unknown() -> None:
    with pytest.raises(BadInput, match=r"unknown key sensors\.ping\.step"):
        load_config(settings=["sensors.ping.step=2"])


@pytest.mark.usefixtures("forgotten")
def test_a_configuration_with_its_keys_goes_to_another_process(plugin: Path) -> None:
    load_plugin(plugin)
    config = load_config(settings=["sensors.ping.step=2", "sensors.ping.hit=1"])
    again = pickle.loads(pickle.dumps(config))
    assert again.model_dump() == config.model_dump()
    assert config.model_dump(exclude_none=True)["sensors"] == {"ping": {"hit": 1.0, "step": 2.0}}


MODEL = (
    "from mapping.sensor_model import SensorModel\nclass Mine(SensorModel):\n    name = 'mine'\n"
)
OCCUPIED_TEXT = "    def occupied(self, sensor, beam_cells): return beam_cells.rho_m * 0 + 0.5\n"


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("kind: str = 'x'", "names a parameter 'kind', as every sensor has one"),
        ("beam_width_rad: float = 1.0", "'beam_width_rad', as every sensor has one"),
        ("hit: str = 'x'", "names a parameter 'hit', which another one has already"),
        ("mine: float", "its parameter 'mine' needs a default"),
        ("mine: float = 'x'", "default of mine: input should be a valid number"),
    ],
)
@pytest.mark.usefixtures("forgotten")
def test_keys_that_cannot_be_get_one_line(tmp_path: Path, key: str, words: str) -> None:
    file = tmp_path / "mine.py"
    parameters = f"    class Parameters(SensorModel.Parameters):\n        {key}\n"
    file.write_text(MODEL + OCCUPIED_TEXT + parameters, encoding="utf-8")
    with pytest.raises(BadInput, match=words) as raised:
        load_plugin(file)
    assert "\n" not in str(raised.value)
    assert "mine" not in SENSOR_MODELS


@pytest.mark.usefixtures("forgotten")
def test_keys_of_another_model_may_be_taken_over(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    shared = "    from mapping.sensor_model.models import Peak, Fading\n"
    for base in ("Peak", "Fading"):
        parameters = f"    class Parameters({base}.Parameters):\n        mine: float = 1.0\n"
        file.write_text(MODEL + OCCUPIED_TEXT + shared + parameters, encoding="utf-8")
        load_plugin(file)
        assert {"mine"} < set(SENSOR_MODELS["mine"].Parameters.model_fields)
        assert load_config(settings=["sensors.ping.model=mine", "sensors.ping.mine=3"])


@pytest.mark.parametrize(
    ("settings", "unused"),
    [
        (["sensors.ping.hit=1"], []),
        (["sensors.ping.p_hit=0.9"], ["sensors.ping.p_hit"]),
        (["sensors.ping.p_hit=0.9", "sensors.ping.model=peak"], []),
        (["sensors.ping.p_hit=0.9", "sensors.*.model=peak"], []),
        (["sensors.*.p_hit=0.9", "sensors.ping.model=peak"], []),
        (["sensors.*.p_hit=0.9", "sensors.ping.model=regions"], ["sensors.*.p_hit"]),
        (["sensors.ping.fade_m=1", "sensors.ping.model=regions"], ["sensors.ping.fade_m"]),
        (["sensors.ping.gaussian=none", "sensors.ping.rasteriser=arcs"], []),
        (["sensors.ping.step=2", "sensors.ping.layer=a"], ["sensors.ping.step"]),
        (["sensors.ping.step=2", "sensors.ping.update=score"], []),
        (["sensors.ping.reach=2", "sensors.dirrs.model=long"], ["sensors.ping.reach"]),
    ],
)
@pytest.mark.usefixtures("forgotten")
def test_keys_that_nobody_goes_by(plugin: Path, settings: list[str], unused: list[str]) -> None:
    load_plugin(plugin)
    assert unused_keys(load_config(settings=settings)) == unused


def test_the_chapters_preset_sets_nothing_in_vain() -> None:
    assert unused_keys(load_config(preset="chapter")) == []
    assert unused_keys(MappingConfig()) == []


FORMER = """
import numpy as np
from mapping.sensor_model import SensorModel
from mapping.update_rules import UpdateRule


class Old(SensorModel):
    name = "old"

    def occupied(self, sensor, cells):
        return np.where(cells.in_band, sensor.p_hit, sensor.p_miss)


class Hits(UpdateRule):
    name, kind, start = "hits", "hits", {"hits": 0.0, "passed": 0.0}
    against_largest = True
    order_matters = True
    per_sample = False

    def __init__(self):
        self.merged = 0

    def merge(self, cells, temp):
        self.merged += 1
        cells["hits"] += temp.band
        cells["passed"] += temp.front

    def values(self, cells):
        return cells["hits"]

    def probability(self, cells, largest):
        return cells["hits"] / largest if largest else cells["hits"]

    def extra(self, cells):
        return {"passed": cells["passed"]}
"""


@pytest.mark.usefixtures("forgotten")
def test_files_written_to_the_former_page_still_work(tmp_path: Path) -> None:
    file = tmp_path / "former.py"
    file.write_text(FORMER, encoding="utf-8")
    chosen = ["sensors.*.model=old", "sensors.*.update=hits", "grid.resolution_m=0.05"]
    options = [part for setting in chosen for part in ("--set", setting)]
    command = ["map", str(SESSION), "-o", str(tmp_path / "map.rrd"), "--plugin", str(file)]
    assert main([*command, "--export", str(tmp_path / "out"), "--quiet", *options]) == 0
    assert UPDATE_RULES["hits"].merged > 0  # type: ignore[attr-defined]
    assert unused_keys(load_config(settings=[*chosen, "sensors.ping.p_hit=0.8"])) == []
    layer = open_map(tmp_path / "map.rrd").layers["ping"]
    assert layer.values is not None
    assert np.array_equal(layer.probability, (layer.values / layer.values.max()))
    assert layer.extra["passed"].max() > 0
