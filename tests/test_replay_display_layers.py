"""The other ways to draw the maps: what lies in the recording is what the display maths says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from rerun.chunk import RrdReader

from mapping.artifacts import Snapshot
from mapping.config import MappingConfig, load_config
from mapping.display import GREEN, against_largest, grey, inked
from mapping.grid import GridGeometry, Layer
from recorder.errors import BadInput
from replay.colours import sensor_colours
from replay.mapping_run import RunResult, map_session
from replay.rrd import layout
from replay.rrd.display_layers import LEVELS, OF_ONE, colours, encode, one

OF = {1: ["ping"], 2: ["ping", "dirrs"], 3: ["ping", "dirrs", "lidar"]}

ROOM = ROOT / "logs" / "room.mcap"
Picture = tuple[int, np.ndarray, np.ndarray]


def config(*more: str) -> MappingConfig:
    return load_config(settings=["grid.resolution_m=0.05", *more])


def mapped(path: Path, *more: str) -> RunResult:
    return map_session(ROOM, config(*more), rrd=path, export=None)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunResult, Path]:
    path = tmp_path_factory.mktemp("display") / "room.rrd"
    return mapped(path, "rerun.stages_every=200"), path


def pictures(path: Path) -> dict[str, list[Picture]]:
    """By entity: step, picture (RGBA) and its corner in metres, of every picture in a file."""
    found: dict[str, list[Picture]] = {}
    content = [f"{layout.DISPLAY}/**", f"{layout.TOGETHER}/**"]
    for chunk in RrdReader(path).store().stream().filter(content=content):
        batch = chunk.to_record_batch()
        if "step" not in batch.schema.names or "SegmentationImage:buffer" not in batch.schema.names:
            continue
        for i in range(batch.num_rows):
            (buffer,) = batch.column("SegmentationImage:buffer")[i].as_py()
            (shape,) = batch.column("SegmentationImage:format")[i].as_py()
            corner = batch.column("Transform3D:translation")[i].as_py()[0][:2]
            image = np.array(buffer, np.uint8).reshape(shape["height"], shape["width"])
            step = batch.column("step")[i].as_py()
            found.setdefault(str(chunk.entity_path), []).append((step, image, np.array(corner)))
    return {entity: sorted(rows, key=lambda row: row[0]) for entity, rows in found.items()}


def expected(result: RunResult) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """By entity: the picture of the whole grid, and the cells seen, at the end."""
    layers = {snapshot.layer.name: snapshot.layer for snapshot in result.snapshots}
    wanted = {}
    for name, layer in layers.items():
        p = layer.probability
        surest = np.minimum(p.astype(float), 1 - 2.0**-24)  # the float32 next below 1
        odds = np.where(layer.observed, surest / (1 - surest), 0)
        for way, picture in (
            ("grey", grey(p)), ("reduced", grey(p, levels=5)), ("odds", grey(against_largest(odds)))
        ):  # fmt: skip
            wanted[layout.display(name, way)] = (picture, layer.observed)
    both = layers["ping"], layers["dirrs"]
    shades = [layer.probability for layer in both]
    seen = both[0].observed | both[1].observed
    inks = [sensor_colours(["ping", "dirrs"])[name] for name in ("ping", "dirrs")]
    common = np.minimum(*shades)
    alone = [shade - common for shade in shades]
    wanted[layout.display("", "two-colours")] = (inked(shades, inks), seen)
    wanted[layout.display("", "three-colours")] = (inked([*alone, common], [*inks, GREEN]), seen)
    return wanted


def test_every_way_is_there_at_the_end_and_at_each_interval(run: tuple[RunResult, Path]) -> None:
    result, path = run
    found, geometry = pictures(path), result.snapshots[0].layer.geometry
    wanted = expected(result)
    assert set(found) == set(wanted)
    for entity, (picture, seen) in wanted.items():
        rows = found[entity]
        assert len(rows) == 4, "three intervals of 200 readings, and the end"
        _, image, corner = rows[-1]
        row0, col0 = np.argwhere(seen).min(axis=0)
        part = np.s_[row0 : row0 + image.shape[0], col0 : col0 + image.shape[1]]
        np.testing.assert_array_equal(image > 0, seen[part], entity)
        assert seen[part].sum() == seen.sum()
        way = entity.rpartition("/")[2]
        count = 1 if way in OF_ONE else 2
        levels = 5 if way == "reduced" else LEVELS[count]
        drawn = colours(way, OF[count], levels)[image.astype(int) - 1].astype(int)
        gap = np.abs(drawn - picture[part]).max(axis=-1)[seen[part]]
        # Half a level of each ink, which may fall on the same channel, and the roundings.
        assert gap.max() <= (1 if way == "reduced" else count * 255 / (levels - 1) / 2 + 1), entity
        lowest = np.array(geometry.origin_m) + 0.05 * np.array([col0, row0])
        assert corner == pytest.approx(lowest, abs=1e-6)


def test_reduced_depth_has_the_shades_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "few.rrd"
    mapped(path, 'rerun.display=["reduced"]', "rerun.display_levels=3")
    found = pictures(path)
    assert set(found) == {layout.display(name, "reduced") for name in ("ping", "dirrs", "fused")}
    for rows in found.values():
        _, image, _ = rows[-1]
        codes = np.unique(image[image > 0])
        assert set(codes) <= {1, 2, 3}
        assert len(codes) >= 2
    assert colours("reduced", ["ping"], 3)[:, 0].tolist() == [255, 127, 0]


def test_nothing_is_drawn_when_nothing_is_asked(tmp_path: Path) -> None:
    path = tmp_path / "none.rrd"
    mapped(path, "rerun.display=[]")
    assert pictures(path) == {}


def test_what_does_not_fit_the_budget_is_left_out_and_reported(tmp_path: Path) -> None:
    path = tmp_path / "small.rrd"
    mapped(path, "rerun.budget_mb=0.05")
    found = pictures(path)
    assert len(found) < 11
    texts = []
    for chunk in RrdReader(path).store().stream().filter(content=layout.EXPLANATION):
        batch = chunk.to_record_batch()
        if "TextDocument:text" in batch.schema.names:
            texts += [str(text) for text in batch.column("TextDocument:text").to_pylist()]
    assert any("Too large for this file's budget, so left out: " in text for text in texts)


def test_an_unknown_way_is_refused() -> None:
    with pytest.raises(BadInput, match="display"):
        config('rerun.display=["sepia"]')


@pytest.mark.parametrize("kind", ["count", "odds", "probability", "binary"])
def test_odds_are_black_where_they_are_largest(kind: str) -> None:
    values = np.array([[0.0, 0.25, 1.0]], np.float32)
    layer = Layer(
        "ping", kind, GridGeometry((0.0, 0.0), 0.1, 1, 3), values, values,
        np.ones((1, 3), bool), {},
    )  # fmt: skip
    picture = one("odds", layer, 5)
    empty, between, full = colours("odds", ["ping"], picture.levels)[
        picture.codes[0].astype(int) - 1
    ]
    assert full.tolist() == [0, 0, 0]
    assert empty.tolist() == [255, 255, 255]
    assert 0 < between[0] <= 255


@pytest.mark.parametrize("count", [1, 2, 3])
def test_every_combination_of_shades_has_a_code_of_its_own(count: int) -> None:
    levels = LEVELS[count]
    steps = np.indices((levels,) * count).reshape(count, 1, -1) / (levels - 1)
    codes = encode(list(steps), levels, np.ones(steps.shape[1:], bool))
    assert codes[0].tolist() == list(range(1, levels**count + 1))
    assert encode(list(steps), levels, np.zeros(steps.shape[1:], bool)).max() == 0
    if count == 3:
        expected = inked(list(steps), [sensor_colours(OF[3])[name] for name in OF[3]])[0]
        np.testing.assert_array_equal(colours("three-colours", OF[3], levels), expected)


def test_snapshots_are_what_is_drawn(run: tuple[RunResult, Path]) -> None:
    """Holds that the run above had what the tests compare with."""
    assert [s.layer.name for s in run[0].snapshots] == ["ping", "dirrs", "fused"]
    assert all(isinstance(s, Snapshot) and s.final for s in run[0].snapshots)
