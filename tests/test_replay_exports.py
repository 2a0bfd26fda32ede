"""The exported files, read back; and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree

import ezdxf
import geojson
import numpy as np
import pytest
import yaml
from PIL import Image

from mapping.artifacts import Border, Finished, RawPoints, Segment, Snapshot
from mapping.grid import GridGeometry, Layer
from recorder.errors import BadInput, OutputExists
from replay.exports import Exporter

GEOMETRY = GridGeometry((-0.2, 0.1), 0.05, 2, 3)
VALUES = np.array([[0.0, 4.0, 1.0], [0.0, 0.0, 2.0]], np.float32)
PROBABILITY = VALUES / 4
OBSERVED = np.array([[True, True, True], [False, True, True]])
CONFLICT = np.full((2, 3), 0.25, np.float32)
POINTS = np.array([[0.1, 1 / 3], [-2.0, 1e-7]])
TIMES = np.array([1_700_000_000_000_000_001, 1_700_000_000_000_000_002])
FILES = {
    "npz", "pgm", "yaml", "borders.json", "segments.geojson", "raw-segments.geojson", "points.csv",
    "dxf", "svg",
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
    assert {path.name for path in made.iterdir()} == wanted | {"summary.json"}


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
