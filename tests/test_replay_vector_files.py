"""Segments and borders in the formats of other programs, read back by other readers."""

from __future__ import annotations

import base64
import io
import json
from xml.etree import ElementTree

import ezdxf
import geojson
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mapping.artifacts import Border, Segment
from mapping.borders import find_borders
from mapping.config import BordersSection, SegmentsSection
from mapping.grid import GridGeometry, Layer
from mapping.segments import segments_from_borders
from replay.pictures.map_svg import map_svg
from replay.vector_files import segments_geojson, vector_dxf
from tests.made_up_grids import thresholded_room

SVG = "{http://www.w3.org/2000/svg}"
HREF = "{http://www.w3.org/1999/xlink}href"


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
    for outline, border in zip(outlines, borders, strict=True):
        corners = np.array(list(outline.get_points("xy")))
        assert len(corners) < len(border.cells)
        assert cells_along(corners, border) == sorted(map(tuple, border.cells.tolist()))
    assert all(outline.closed for outline in outlines)


def cells_along(corners: NDArray[np.float64], border: Border) -> list[tuple[int, int]]:
    """All cells that a closed outline goes through, from corner to corner, in order of place."""
    origin, size = np.array(border.geometry.origin_m), border.geometry.resolution_m
    cells = np.rint((corners - origin) / size - 0.5).astype(int)[:, ::-1]
    found = []
    for here, there in zip(cells, np.roll(cells, -1, axis=0), strict=True):
        step = there - here
        steps = int(np.abs(step).max())
        found += [tuple((here + step * k // steps).tolist()) for k in range(steps)]
    return sorted(found)


def test_svg_stands_upright(segments: list[Segment], borders: list[Border]) -> None:
    root = ElementTree.fromstring(map_svg(segments, borders))
    left, top, width, height = (float(v) for v in root.attrib["viewBox"].split())
    lines = [path for path in root.findall(f"{SVG}path") if "data-layer" in path.attrib]
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


def test_svg_is_a_page_of_paper_with_map_scale_and_units(
    segments: list[Segment], borders: list[Border]
) -> None:
    geometry = borders[0].geometry
    occupied = thresholded_room().occupied
    values = occupied.astype(np.float32)
    layer = Layer("fu<sed", "probability", geometry, values, values, np.ones_like(occupied), {})
    root = ElementTree.fromstring(map_svg(segments, borders, layer=layer))
    width, height = (float(v) for v in root.attrib["viewBox"].split()[2:])
    wide_mm, high_mm = (float(root.attrib[k].removesuffix("mm")) for k in ("width", "height"))
    assert wide_mm / high_mm == pytest.approx(width / height, rel=1e-4)
    fills = [max(wide_mm / w, high_mm / h) for w, h in ((277.0, 190.0), (190.0, 277.0))]
    assert min(fills) == pytest.approx(1.0, rel=1e-4)
    (image,) = root.iter(f"{SVG}image")
    x, y, w, h = (float(image.attrib[k]) for k in ("x", "y", "width", "height"))
    with Image.open(io.BytesIO(base64.b64decode(image.attrib[HREF].partition(",")[2]))) as read:
        grey = np.asarray(read.convert("L"))[::-1]
    assert grey.shape == (round(h / geometry.resolution_m), round(w / geometry.resolution_m))
    corner = geometry.cells_of(np.array([[x + 1e-6, -y - h + 1e-6]]))[0]
    shown = occupied[corner[0] : corner[0] + len(grey), corner[1] : corner[1] + grey.shape[1]]
    np.testing.assert_array_equal(grey == 0, shown)
    texts = ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]
    assert any(text.startswith("fu<sed") for text in texts)
    assert any(" on A4; x and y in metres" in text for text in texts)
    assert {"walls found", "borders of occupied cells", "free", "occupied"} <= set(texts)


def test_nothing_found_is_still_a_file() -> None:
    assert json.loads(segments_geojson([])) == {
        "type": "FeatureCollection", "frame": "map", "unit": "metre", "features": [],
    }  # fmt: skip
    assert len(ezdxf.read(io.StringIO(vector_dxf([]))).modelspace()) == 0
    assert ElementTree.fromstring(map_svg([])).tag == f"{SVG}svg"


def test_awkward_layer_names_survive(segments: list[Segment]) -> None:
    name = 'left <"ping"> & *'
    odd = [
        Segment(name, "raw", None, s.start_m, s.end_m, s.rho_m, s.alpha_rad, s.covariance, s.rms_m,
                s.points)
        for s in segments[:2]
    ]  # fmt: skip
    assert json.loads(segments_geojson(odd))["features"][0]["properties"]["layer"] == name
    root = ElementTree.fromstring(map_svg(odd))
    assert root.findall(f"{SVG}path")[0].attrib["data-layer"] == name
    assert len(ezdxf.read(io.StringIO(vector_dxf(odd))).modelspace()) == 2


def test_geometry_is_that_of_the_map() -> None:
    geometry = GridGeometry((-1.0, 4.0), 0.5, 1, 1)
    border = Border("ping", 0, True, geometry, np.array([[0, 0]]))
    (outline,) = ezdxf.read(io.StringIO(vector_dxf([], [border]))).modelspace()
    assert [tuple(place) for place in outline.get_points("xy")] == [(-0.75, 4.25)]
