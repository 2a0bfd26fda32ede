"""The exported files, read back; and what is refused."""

from __future__ import annotations

import io
import json
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree

import ezdxf
import geojson
import numpy as np
import pytest
import yaml
from conftest import ROOT
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image
from test_replay_diff_sources import nav2_cell

from echogrid import main
from mapping.artifacts import Border, Finished, RawPoints, Segment, Snapshot
from mapping.config import load_config
from mapping.config_sections import ExportSection
from mapping.grid import GridGeometry, Layer
from mapping.pipeline import build_maps, readings_of_each
from mapping.placed_session import place_session
from mapping.readings import raw_points
from recorder.errors import BadInput, OutputExists
from recorder.geometry import SE2
from recorder.messages import Pose
from recorder.session import read_session
from replay.exports import Exporter, layer_pgm, layer_png, map_server_yaml
from replay.mapping_run import map_session
from replay.trajectory import tum_lines

LOGS = ROOT / "logs"
GEOMETRY = GridGeometry((-0.2, 0.1), 0.05, 2, 3)
VALUES = np.array([[0.0, 4.0, 1.0], [0.0, 0.0, 2.0]], np.float32)
PROBABILITY = VALUES / 4
OBSERVED = np.array([[True, True, True], [False, True, True]])
CONFLICT = np.full((2, 3), 0.25, np.float32)
POINTS = np.array([[0.1, 1 / 3], [-2.0, 1e-7]])
TIMES = np.array([1_700_000_000_000_000_001, 1_700_000_000_000_000_002])
FILES = {
    "npz", "pgm", "yaml", "borders.json", "segments.geojson", "raw-segments.geojson", "points.csv",
    "dxf", "svg", "png", "pgw",
}  # fmt: skip


def layer(name: str = "ping", values: np.ndarray = VALUES) -> Layer:
    return Layer(name, "count", GEOMETRY, values, PROBABILITY, OBSERVED, {"conflict": CONFLICT})


def segment(source: str, rho: float) -> Segment:
    return Segment("ping", source, None, (0.0, rho), (1.0, rho), rho, np.pi / 2, np.eye(2), 0.01, 9)


def export(directory: Path, *, force: bool = False) -> Path:
    exporter = Exporter(
        directory,
        config_text="[grid]\nresolution_m = 0.05\n",
        config={"grid": {"resolution_m": 0.05, "size_m": (1.0, float("inf"))}},
        force=force,
    )
    cells = np.array([[0, 1], [1, 2]])
    exporter(Snapshot(layer(values=VALUES + 1), "count", final=False))
    exporter(Snapshot(layer(), "count", final=True))
    exporter(Snapshot(layer("fused"), "bayes", final=True))
    exporter(Snapshot(layer("ping", VALUES + 1), "count", final=False))
    exporter(Border("ping", 1, True, GEOMETRY, cells))
    exporter(segment("grid", 0.5))
    exporter(segment("raw", 0.75))
    exporter(RawPoints("ping", POINTS, TIMES))
    exporter(Finished(7, MappingProxyType({"ping": 5}), MappingProxyType({"pose gap": 2})))
    exporter.close()
    return directory


@pytest.fixture
def made(tmp_path: Path) -> Path:
    return export(tmp_path / "deep" / "out")


def test_every_layer_has_its_files_and_no_part_stays(made: Path) -> None:
    wanted = {f"{name}.{ending}" for name in ("ping", "fused") for ending in FILES}
    assert {path.name for path in made.iterdir()} == wanted | {
        "summary.json", "trajectory.tum",
    }  # fmt: skip


def test_npz_holds_the_final_values_and_the_extra_arrays(made: Path) -> None:
    with np.load(made / "ping.npz", allow_pickle=False) as read:
        assert read["values"].dtype == np.float32
        np.testing.assert_array_equal(read["values"], VALUES)
        np.testing.assert_array_equal(read["conflict"], CONFLICT)
        assert tuple(read["origin_m"]) == GEOMETRY.origin_m
        assert float(read["resolution_m"]) == GEOMETRY.resolution_m
        assert (str(read["kind"]), str(read["layer"])) == ("count", "ping")


def test_pgm_has_the_highest_y_on_top_and_unseen_cells_unknown(made: Path) -> None:
    with Image.open(made / "ping.pgm") as read:
        assert read.mode == "L"
        grey = np.asarray(read)
    np.testing.assert_array_equal(grey, [[128, 255, 128], [255, 0, 191]])


def test_yaml_is_what_map_server_reads(made: Path) -> None:
    content = yaml.safe_load((made / "ping.yaml").read_text())
    assert content == {
        "image": "ping.pgm", "mode": "trinary", "resolution": 0.05, "origin": [-0.2, 0.1, 0.0],
        "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.25,
    }  # fmt: skip
    unknown = 1 - 128 / 255
    assert content["free_thresh"] < unknown < content["occupied_thresh"]


def test_borders_segments_and_points_come_back(made: Path) -> None:
    borders = json.loads((made / "ping.borders.json").read_text())
    assert borders == [{"outer": True, "cells": [[0, 1], [1, 2]]}]
    assert json.loads((made / "fused.borders.json").read_text()) == []
    for name, source, rho in (("segments", "grid", 0.5), ("raw-segments", "raw", 0.75)):
        (feature,) = geojson.loads((made / f"ping.{name}.geojson").read_text()).features
        assert feature.properties["source"] == source
        assert feature.geometry.coordinates == [[0.0, rho], [1.0, rho]]
    head, *lines = (made / "ping.points.csv").read_text().splitlines()
    assert head == "t_ns,x_m,y_m"
    assert [int(line.split(",")[0]) for line in lines] == TIMES.tolist()
    read = [[float(v) for v in line.split(",")[1:]] for line in lines]
    assert read == POINTS.tolist()
    assert (made / "fused.points.csv").read_text() == "t_ns,x_m,y_m\n"


def test_drawings_hold_the_borders_and_the_lines_of_the_grid_alone(made: Path) -> None:
    drawing = ezdxf.readfile(made / "ping.dxf")
    assert not drawing.audit().has_errors
    (line,) = drawing.modelspace().query('LINE[layer=="ping segments"]')
    assert tuple(line.dxf.start.vec2) == (0.0, 0.5)
    assert len(drawing.modelspace().query("LWPOLYLINE")) == 1
    root = ElementTree.fromstring((made / "ping.svg").read_text())
    layers = [path.attrib["data-layer"] for path in root.iter("{http://www.w3.org/2000/svg}path")]
    assert layers == ["ping", "ping"]
    assert len(ezdxf.readfile(made / "fused.dxf").modelspace()) == 0


def test_summary_holds_counts_configuration_and_versions(made: Path) -> None:
    held = json.loads((made / "summary.json").read_text())
    assert (held["readings"], held["used"], held["dropped"]) == (
        7,
        {"ping": 5},
        {"pose gap": 2},
    )
    assert held["config"] == {"grid": {"resolution_m": 0.05, "size_m": [1.0, "inf"]}}
    assert "resolution_m = 0.05" in held["config_toml"]
    assert held["layers"]["fused"] == {"kind": "count", "rule": "bayes"}
    assert set(held["versions"]) == {"echogrid", "numpy", "python"}
    assert held["versions"]["numpy"] == np.__version__


def test_summary_names_the_rule_of_each_sensor(tmp_path: Path) -> None:
    """The configuration need not: a rule that nobody set follows the kind of the sensor."""
    config = load_config(settings=["grid.resolution_m=0.1"])
    map_session(ROOT / "logs/room.mcap", config, rrd=None, export=tmp_path / "out")
    held = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert {name: each["update"] for name, each in held["sensors"].items()} == {
        "ping": "pooled", "dirrs": "bayes",
    }  # fmt: skip
    assert held["sensors"]["ping"]["kind"] == held["sensors"]["ping"]["layer"] == "ping"


def test_the_same_run_gives_the_same_bytes(made: Path, tmp_path: Path) -> None:
    again = export(tmp_path / "again")
    for path in made.iterdir():
        assert path.read_bytes() == (again / path.name).read_bytes(), path.name


def test_a_filled_directory_is_refused_and_force_replaces(tmp_path: Path) -> None:
    (tmp_path / "ping.yaml").write_text("old")
    with pytest.raises(OutputExists, match="--force"):
        export(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["ping.yaml"]
    export(tmp_path, force=True)
    assert (tmp_path / "ping.yaml").read_text().startswith("image: ping.pgm")


def test_what_cannot_be_a_directory_or_a_file_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="file"):
        export(tmp_path / "file", force=True)
    exporter = Exporter(tmp_path / "new", config_text="", config={}, force=False)
    with pytest.raises(BadInput, match="name"):
        exporter(Snapshot(layer("../escaped"), "count", final=True))


def test_the_world_file_puts_each_pixel_where_its_cell_is(made: Path) -> None:
    """As GIS reads it: x = A col + C, y = E row + F, of the centres of pixels."""
    a, d, b, e, c, f = map(float, (made / "ping.pgw").read_text().split())
    assert (b, d) == (0.0, 0.0)
    rows, cols = GEOMETRY.shape
    for row in range(rows):
        for col in range(cols):
            centre = GEOMETRY.centres_of(np.array([[row, col]]))[0]
            assert (a * col + c, e * (rows - 1 - row) + f) == pytest.approx(tuple(centre))
    with Image.open(made / "ping.png") as picture, Image.open(made / "ping.pgm") as pgm:
        np.testing.assert_array_equal(np.asarray(picture), np.asarray(pgm))


def test_sixteen_bits_keep_what_eight_round_off() -> None:
    deep = layer("a", VALUES)
    with Image.open(io.BytesIO(layer_png(deep, ExportSection(png_bits=16)))) as picture:
        grey = np.asarray(picture)
    assert grey.max() > 255
    known = OBSERVED[::-1]
    np.testing.assert_allclose(1.0 - grey[known] / 65535, PROBABILITY[::-1][known], atol=1e-5)


@pytest.mark.parametrize(("free", "occupied"), [(0.25, 0.65), (0.1, 0.4), (0.6, 0.9)])
def test_map_server_reads_each_cell_as_the_thresholds_mean_it(free: float, occupied: float) -> None:
    """By nav2's own rules (:func:`nav2_cell`); what was never seen is unknown."""
    section = ExportSection(free_thresh=free, occupied_thresh=occupied)
    read = yaml.safe_load(map_server_yaml(layer(), section))
    assert (read["free_thresh"], read["occupied_thresh"], read["negate"]) == (free, occupied, 0)
    with Image.open(io.BytesIO(layer_pgm(layer(), section))) as picture:
        grey = np.asarray(picture)[::-1]
    for at in np.ndindex(grey.shape):
        cell = nav2_cell((int(grey[at]), 255), 255, read["mode"], False, False, (free, occupied))
        p = float(PROBABILITY[at])
        wanted = -1 if not OBSERVED[at] else 100 if p > occupied else 0 if p < free else -1
        assert cell == wanted, (at, p)


def test_thresholds_that_leave_nothing_between_them_are_refused() -> None:
    with pytest.raises(BadInput, match="must lie below"):
        load_config(settings=["export.free_thresh=0.7"])


def test_a_trajectory_as_evo_reads_it() -> None:
    """Its reader takes rows of eight numbers apart by spaces, unit quaternions, rising times."""
    poses = [Pose(1_700_000_000_123_456_789, SE2(1.5, -2.0, 3.0)), Pose(10**18 * 2, SE2(0, 0, 0))]
    text = "".join(tum_lines(poses))
    rows = [[float(v) for v in line.split(" ")] for line in text.splitlines()]
    assert [len(row) for row in rows] == [8, 8]
    assert text.startswith("1700000000.123456789 1.5 -2 0 0 0 ")
    assert rows[0][1:4] == [1.5, -2.0, 0.0]
    assert np.hypot(rows[0][6], rows[0][7]) == pytest.approx(1.0, abs=1e-11)
    assert 2.0 * np.arctan2(rows[0][6], rows[0][7]) == pytest.approx(3.0)


def test_map_writes_the_bag_and_the_trajectory(tmp_path: Path) -> None:
    """Every layer, as other readers of ROS 2 bags see it, is the exported one."""
    bag, out = tmp_path / "maps.mcap", tmp_path / "out"
    arguments = ["map", str(ROOT / "logs" / "room.mcap"), "--set", "grid.resolution_m=0.05"]
    assert main([*arguments, "-o", "-", "--mcap", str(bag), "--export", str(out), "--quiet"]) == 0
    with bag.open("rb") as file:
        found = {
            channel.topic: message
            for _, channel, _, message in make_reader(
                file, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages()
        }
    assert {"/map/ping", "/map/dirrs", "/map/fused", "/path", "/tf", "/tf_static"} <= set(found)
    for name in ("ping", "dirrs", "fused"):
        grid = found[f"/map/{name}"]
        with np.load(out / f"{name}.npz") as exported:
            assert (grid.info.height, grid.info.width) == exported["values"].shape
            assert grid.info.origin.position.x == pytest.approx(exported["origin_m"][0])
            walls = np.asarray(grid.data).reshape(exported["values"].shape) > 65
            if str(exported["kind"]) == "probability":
                np.testing.assert_array_equal(walls, np.round(100 * exported["values"]) > 65)
    rows = (out / "trajectory.tum").read_text().splitlines()
    assert len(rows) == len(found["/path"].poses) > 100
    assert main([*arguments, "-o", "-", "--mcap", str(tmp_path / "maps.bag")]) == 2
    assert main([*arguments, "-o", "-", "--mcap", str(bag)]) == 2  # it exists


def test_of_a_long_session_some_raw_points_make_lines_and_all_are_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    whole = place_session(list(read_session(LOGS / "room.mcap").messages())[:2000], load_config())
    everything = {sensor.name: points for sensor, points, *_ in raw_points(whole)}
    monkeypatch.setattr("mapping.readings.MOST_RAW", 100)
    monkeypatch.setattr("mapping.readings.STRETCH", 10)
    used = readings_of_each(whole)
    assert used == readings_of_each(list(whole))
    some = {sensor.name: points for sensor, points, *_ in raw_points(whole, used)}
    for name, points in some.items():
        assert used[name] > 100 >= len(points) > 30
        rows = {tuple(row): k for k, row in reversed(list(enumerate(everything[name].tolist())))}
        at = [rows[tuple(row)] for row in points.tolist()]
        assert at[0] < 3 * used[name] / 10
        assert at[-1] > len(everything[name]) - 3 * used[name] / 10
    exporter = Exporter(tmp_path / "out", config_text="", config={}, force=False)
    for artifact in build_maps(whole, load_config(), watched=False):
        exporter(artifact)
    exporter.close((), whole)
    for name, points in everything.items():
        written = np.loadtxt(tmp_path / "out" / f"{name}.points.csv", delimiter=",", skiprows=1)
        np.testing.assert_array_equal(written[:, 1:], points)
