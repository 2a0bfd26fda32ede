"""Segments and borders in the formats of other programs, read back by other readers."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from xml.etree import ElementTree

import ezdxf
import geojson
import numpy as np
import pytest

from mapping.artifacts import Border, Segment
from mapping.borders import find_borders
from mapping.config import BordersSection, SegmentsSection
from mapping.grid import GridGeometry
from mapping.segments import segments_from_borders
from replay.vector_files import (
    segments_geojson,
    vector_dxf,
    vector_svg,
)
from tests import naive_drawings
from tests.made_up_grids import thresholded_room

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def borders() -> list[Border]:
    return find_borders(thresholded_room(), BordersSection())


@pytest.fixture(scope="module")
def segments(borders: list[Border]) -> list[Segment]:
    return segments_from_borders(borders, SegmentsSection())


def test_segments_as_geojson_keep_ends_and_properties(segments: list[Segment]) -> None:
    read = geojson.loads(segments_geojson(segments))
    assert read.is_valid
    assert len(read.features) == len(segments) > 4
    for feature, segment in zip(read.features, segments, strict=True):
        assert feature.geometry.type == "LineString"
        np.testing.assert_allclose(
            feature.geometry.coordinates, [segment.start_m, segment.end_m], atol=1e-9
        )
        properties = feature.properties
        assert (properties["layer"], properties["border"]) == ("fused", segment.border)
        assert (properties["rho"], properties["alpha"]) == (segment.rho_m, segment.alpha_rad)
        assert properties["covariance"] == segment.covariance.tolist()
        assert (properties["rms"], properties["n"]) == (segment.rms_m, segment.points)


def test_dxf_has_lines_in_metres_on_named_layers(
    segments: list[Segment], borders: list[Border]
) -> None:
    drawing = ezdxf.read(io.StringIO(vector_dxf(segments, borders)))
    assert drawing.header["$INSUNITS"] == 6
    assert not drawing.audit().has_errors
    lines = drawing.modelspace().query('LINE[layer=="fused segments"]')
    found = sorted((*line.dxf.start.vec2, *line.dxf.end.vec2) for line in lines)
    wanted = sorted((*segment.start_m, *segment.end_m) for segment in segments)
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    outlines = drawing.modelspace().query('LWPOLYLINE[layer=="fused borders"]')
    assert [len(outline) for outline in outlines] == [len(border.cells) for border in borders]
    assert all(outline.closed for outline in outlines)


def test_svg_stands_upright(segments: list[Segment], borders: list[Border]) -> None:
    root = ElementTree.fromstring(vector_svg(segments, borders))
    left, top, width, height = (float(v) for v in root.attrib["viewBox"].split())
    lines = root.findall(f"{SVG}path")
    segments_read = [line for line in lines if "Z" not in line.attrib["d"]]
    assert len(segments_read) == len(segments)
    assert len(lines) - len(segments_read) == len(borders)
    for line, segment in zip(segments_read, segments, strict=True):
        numbers = [float(v) for v in line.attrib["d"].replace("M", "").replace("L", ",").split(",")]
        (x0, y0), (x1, y1) = segment.start_m, segment.end_m
        np.testing.assert_allclose(numbers, [x0, -y0, x1, -y1], atol=1e-9)
        assert line.attrib["data-layer"] == "fused"
        assert left < x0 < left + width
        assert top < -y0 < top + height


def test_nothing_found_is_still_a_file() -> None:
    assert json.loads(segments_geojson([])) == {
        "type": "FeatureCollection", "frame": "map", "unit": "metre", "features": [],
    }  # fmt: skip
    assert len(ezdxf.read(io.StringIO(vector_dxf([]))).modelspace()) == 0
    assert ElementTree.fromstring(vector_svg([])).tag == f"{SVG}svg"


def test_awkward_layer_names_survive(segments: list[Segment]) -> None:
    name = 'left <"ping"> & *'
    odd = [
        Segment(name, "raw", None, s.start_m, s.end_m, s.rho_m, s.alpha_rad, s.covariance, s.rms_m,
                s.points)
        for s in segments[:2]
    ]  # fmt: skip
    assert json.loads(segments_geojson(odd))["features"][0]["properties"]["layer"] == name
    root = ElementTree.fromstring(vector_svg(odd))
    assert root.findall(f"{SVG}path")[0].attrib["data-layer"] == name
    assert len(ezdxf.read(io.StringIO(vector_dxf(odd))).modelspace()) == 2


def test_geometry_is_that_of_the_map() -> None:
    geometry = GridGeometry((-1.0, 4.0), 0.5, 1, 1)
    border = Border("ping", 0, True, geometry, np.array([[0, 0]]))
    (outline,) = ezdxf.read(io.StringIO(vector_dxf([], [border]))).modelspace()
    assert [tuple(place) for place in outline.get_points("xy")] == [(-0.75, 4.25)]


@pytest.mark.parametrize("names", [(), ("ping",), ("a", "A", "b/b", "ü"), tuple("abcdefgh")])
def test_drawings_are_those_of_the_libraries_to_the_byte(
    segments: list[Segment], borders: list[Border], names: tuple[str, ...]
) -> None:
    lines = [replace(s, layer=name, border=k) for name in names for k, s in enumerate(segments[:3])]
    lines += [replace(s, border=None, start_m=(-0.0, 1e-17)) for s in lines[:1]]
    outlines = [replace(b, layer=name) for name in names[::-1] for b in borders]
    assert vector_dxf(lines, outlines) == naive_drawings.dxf(lines, outlines)
    assert vector_svg(lines, outlines) == naive_drawings.svg(lines, outlines)
