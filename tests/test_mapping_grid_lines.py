"""From grids to lines: where they lie, that a wall is one of them, and that ghosts are none."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from mapping.artifacts import Border, Segment, Thresholded
from mapping.borders import find_borders
from mapping.config import BordersSection, SegmentsSection
from mapping.grid import GridGeometry, Layer
from mapping.segments import (
    reachable_cells,
    segments_from_borders,
    segments_from_grid,
    segments_from_ridge,
)
from mapping.segments.ridge import thinned
from tests.border_grids import CLASSES
from tests.made_up_grids import RESOLUTION_M, solid_rectangle, thresholded_room
from tests.naive_lines import naive_thinning

Ends = tuple[tuple[float, float], tuple[float, float]]


def borders_of(thresholded: Thresholded) -> list[Border]:
    return find_borders(thresholded, BordersSection())


def rounded(segments: list[Segment]) -> list[Ends]:
    """Ends to the millimetre, the lesser first, in order."""
    pairs = [sorted([s.start_m, s.end_m]) for s in segments]
    return sorted(
        tuple(tuple(round(float(v), 3) + 0.0 for v in p) for p in pair)  # type: ignore[misc]
        for pair in pairs
    )


ROOM_WALLS = [  # centre lines of the walls, and the faces of the solid box
    ((-0.29, 1.21), (-0.29, 4.39)),
    ((-0.29, 1.21), (3.69, 1.21)),
    ((-0.29, 4.39), (3.69, 4.39)),
    ((0.3, 3.4), (0.3, 3.8)),
    ((0.3, 3.4), (0.9, 3.4)),
    ((0.3, 3.8), (0.9, 3.8)),
    ((0.9, 3.4), (0.9, 3.8)),
    ((1.71, 1.21), (1.71, 2.8)),
    ((3.69, 1.21), (3.69, 4.39)),
]


def test_a_room_of_one_cell_walls_has_one_line_a_wall() -> None:
    found = segments_from_borders(borders_of(thresholded_room()), SegmentsSection())
    assert len(found) == len(ROOM_WALLS)
    np.testing.assert_allclose(rounded(found), ROOM_WALLS, atol=0.6 * RESOLUTION_M)
    assert {s.source for s in found} == {"grid"}
    assert {s.border for s in found} == {0, 1, 2}
    assert [s.length_m for s in found] == sorted((s.length_m for s in found), reverse=True)


def test_the_ridge_of_one_cell_walls_is_the_same_lines() -> None:
    found = segments_from_ridge(thresholded_room(), SegmentsSection())
    walls = [wall for wall in ROOM_WALLS if not 0.2 < wall[1][0] < 1.0]
    outside = [e for e in rounded(found) if not 0.2 < e[1][0] < 1.0]
    np.testing.assert_allclose(outside, walls, atol=1.1 * RESOLUTION_M)


@pytest.mark.parametrize("angle_deg", [0, 3, 10, 30, 45, 80])
def test_lines_lie_on_the_face_and_not_half_a_cell_inside(angle_deg: float) -> None:
    thresholded, corners = solid_rectangle(math.radians(angle_deg))
    found = segments_from_borders(borders_of(thresholded), SegmentsSection())
    assert len(found) == 4
    offsets = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / math.dist(start, end)
        middles = [np.mean([s.start_m, s.end_m], axis=0) for s in found]
        nearest = found[int(np.argmin([math.dist(m, (start + end) / 2) for m in middles]))]
        offsets += [
            float(along[0] * (p[1] - start[1]) - along[1] * (p[0] - start[0]))
            for p in (nearest.start_m, nearest.end_m)
        ]
        assert nearest.length_m == pytest.approx(math.dist(start, end), abs=0.06)
    assert abs(float(np.mean(offsets))) < 0.004, "half a cell would be 0.025"
    assert max(map(abs, offsets)) < 0.02


def test_epsilon_is_never_finer_than_the_cells() -> None:
    thresholded, _ = solid_rectangle(math.radians(3.0))
    fine = SegmentsSection(epsilon_m=0.001, merge="none")
    assert len(segments_from_borders(borders_of(thresholded), fine)) <= 8


def band_room(thickness: int) -> Thresholded:
    """Four walls of many cells, 4 x 3 m inside, at 2 cm."""
    occupied = np.zeros((220, 280), np.bool_)
    occupied[30:190, 30:250] = True
    occupied[30 + thickness : 190 - thickness, 30 + thickness : 250 - thickness] = False
    return Thresholded("ping", GridGeometry((0.0, 0.0), 0.02, 220, 280), 0.51, occupied)


def test_a_thick_band_is_one_line_a_wall_by_its_ridge() -> None:
    for thickness in (5, 9, 15):
        found = segments_from_ridge(band_room(thickness), SegmentsSection())
        assert len(found) == 4, thickness
        half = thickness * 0.02 / 2
        for segment in found:
            distance = min(
                abs(segment.start_m[axis] - at) + abs(segment.end_m[axis] - at)
                for axis, at in ((0, 0.6 + half), (0, 5 - half), (1, 0.6 + half), (1, 3.8 - half))
            )
            assert distance < 0.03


def test_two_faces_of_a_thin_band_become_one_line_and_of_a_thick_one_stay() -> None:
    thin, thick = (
        segments_from_borders(borders_of(band_room(n)), SegmentsSection()) for n in (5, 15)
    )
    assert (len(thin), len(thick)) == (4, 8)
    assert thin[0].length_m == pytest.approx(4.4 - 0.05, abs=0.1)


def test_pieces_of_a_wall_are_joined_across_borders_and_gaps_are_kept() -> None:
    occupied = np.zeros((40, 300), np.bool_)
    occupied[20, 10:290] = True
    occupied[20, 60:65] = occupied[20, 100:112] = False  # 10 and 24 cm
    occupied[20, 180:220] = False  # 80 cm: a door
    thresholded = Thresholded("x", GridGeometry((0.0, 0.0), 0.02, 40, 300), 0.5, occupied)
    for source in ("borders", "ridge"):
        config = SegmentsSection(source=source)  # type: ignore[arg-type]
        found = segments_from_grid(thresholded, borders_of(thresholded), config)
        ends = np.array(rounded(found))
        np.testing.assert_allclose(ends[:, :, 0], [[0.2, 3.6], [4.4, 5.8]], atol=0.03)
        np.testing.assert_allclose(ends[:, :, 1], 0.41, atol=0.011)


def ghost_layer() -> tuple[Layer, NDArray[np.float64]]:
    """A room whose west wall has a gap of 6 cm, free space and a band behind it, and a path."""
    probability = np.full((160, 260), 0.5, np.float32)
    probability[20:140, 100:240] = 0.9
    probability[30:130, 110:230] = 0.02  # the room, walls 20 cm thick
    probability[40:120, 30:100] = 0.1  # seemingly free, behind the west wall
    probability[40:120, 20:30] = 0.9  # and a wall behind that
    probability[75:78, 100:110] = 0.02  # the gap
    geometry = GridGeometry((0.0, 0.0), 0.02, 160, 260)
    path = np.column_stack([np.linspace(2.6, 4.2, 30), np.full(30, 1.6)])
    observed = probability != 0.5
    return Layer("ping", "probability", geometry, probability, probability, observed, {}), path


def test_reachable_is_where_a_robot_fits_through() -> None:
    layer, path = ghost_layer()
    reachable = reachable_cells(layer, path)
    assert reachable[31:129, 111:229].mean() > 0.99
    assert not reachable[:, :100].any()
    assert not reachable[layer.probability > 0.5].any()
    wide = reachable_cells(layer, path, passage_m=0.03)
    assert wide[60:100, 40:90].all(), "a smaller robot would have come through"
    assert not reachable_cells(layer, path + 100.0).any()
    assert not reachable_cells(layer, np.empty((0, 2))).any()


@pytest.mark.parametrize("source", ["borders", "ridge"])
def test_what_lies_behind_walls_makes_no_lines(source: Literal["borders", "ridge"]) -> None:
    layer, path = ghost_layer()
    occupied = layer.probability > 0.55
    thresholded = Thresholded("ping", layer.geometry, 0.55, occupied)
    config = SegmentsSection(source=source)
    everything = segments_from_grid(thresholded, borders_of(thresholded), config)
    seen = segments_from_grid(
        thresholded, borders_of(thresholded), config, reachable=reachable_cells(layer, path)
    )
    assert min(min(s.start_m[0], s.end_m[0]) for s in everything) < 0.7
    assert min(min(s.start_m[0], s.end_m[0]) for s in seen) > 1.95
    inner = [(2.2, 0.6), (4.6, 2.6)]  # of the room, x and y
    if source == "borders":
        for segment in seen:
            at = segment.start_m, segment.end_m
            off = min(
                abs(p - x) + abs(q - x)
                for axis in (0, 1)
                for x in (inner[0][axis], inner[1][axis])
                for p, q in [(at[0][axis], at[1][axis])]
            )
            assert off < 0.03
    assert 3 <= len(seen) <= 6


def test_cells_that_were_never_observed_make_no_lines() -> None:
    thresholded = thresholded_room()
    observed = np.zeros(thresholded.geometry.shape, np.bool_)
    observed[:, :100] = True
    for segments in (
        segments_from_borders(borders_of(thresholded), SegmentsSection(), observed=observed),
        segments_from_ridge(thresholded, SegmentsSection(), observed=observed),
    ):
        assert segments
        assert max(max(s.start_m[0], s.end_m[0]) for s in segments) < -0.5 + 100 * 0.02 + 0.03


@pytest.mark.parametrize("name", CLASSES)
def test_thinning_equals_its_definition_and_leaves_lines(name: str) -> None:
    rng = np.random.default_rng([3, sorted(CLASSES).index(name)])
    for _ in range(25):
        grid = CLASSES[name](rng)
        np.testing.assert_array_equal(thinned(grid), naive_thinning(grid))


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("source", ["borders", "ridge"])
def test_any_grid_gives_lines_or_none(name: str, source: Literal["borders", "ridge"]) -> None:
    rng = np.random.default_rng(4)
    for _ in range(15):
        grid = CLASSES[name](rng)
        geometry = GridGeometry((-3.0, 7.0), 0.05, *grid.shape)
        thresholded = Thresholded("x", geometry, 0.5, grid)
        for wrap in ("on", "off", "drop"):
            config = SegmentsSection(source=source, wrap=wrap)  # type: ignore[arg-type]
            for segment in segments_from_grid(thresholded, borders_of(thresholded), config):
                assert np.isfinite([*segment.start_m, *segment.end_m]).all()
                assert np.linalg.eigvalsh(segment.covariance).min() > -1e-12
                assert segment.length_m >= config.min_length_m
    assert segments_from_grid(Thresholded("x", geometry, 0.5, grid & False), [], config) == []
