"""Lines of many laser scans: each wall once, where it stands, whatever the order of the scans."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.beams import Beam
from mapping.config import load_config
from mapping.segments.scan_lines import segments_of_scans
from recorder.geometry import SE2

SECTION = load_config().segments
WIDTH_M, HEIGHT_M = 6.0, 4.0


def scan_of_rectangle(number: int, pose: SE2, noise_m: float, random: np.random.Generator) -> Beam:
    """What a laser sees in a room from (0, 0) to (6, 4), by the nearest of four walls."""
    bearings = np.radians(np.arange(-135.0, 135.5, 0.5))
    angles = bearings + pose.heading_rad
    dx, dy = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        x = np.where(dx > 0.0, (WIDTH_M - pose.x_m) / dx, -pose.x_m / dx)
        y = np.where(dy > 0.0, (HEIGHT_M - pose.y_m) / dy, -pose.y_m / dy)
    ranges = np.minimum(x, y) + noise_m * random.standard_normal(len(angles))
    return Beam(
        number=number, t_ns=number, sensor="lidar", layer="lidar", world_from_base=pose,
        world_from_sensor=pose, bearings_rad=bearings, ranges_m=ranges,
        beam_width_rad=math.radians(0.5), reach_m=30.0,
    )  # fmt: skip


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**32 - 1))
def test_four_walls_from_many_places(seed: int) -> None:
    random = np.random.default_rng(seed)
    poses = [
        SE2(random.uniform(0.8, 5.2), random.uniform(0.8, 3.2), random.uniform(-3.0, 3.0))
        for _ in range(12)
    ]
    beams = [scan_of_rectangle(i, pose, 0.005, random) for i, pose in enumerate(poses)]
    found = segments_of_scans(beams, SECTION, layer="lidar")
    assert len(found) == 4
    lengths = sorted(math.dist(line.start_m, line.end_m) for line in found)
    assert lengths == pytest.approx([HEIGHT_M, HEIGHT_M, WIDTH_M, WIDTH_M], abs=0.12)
    for line in found:
        ends = np.array([line.start_m, line.end_m])
        off = [ends[:, 0], ends[:, 0] - WIDTH_M, ends[:, 1], ends[:, 1] - HEIGHT_M]
        assert min(float(np.abs(each).max()) for each in off) < 0.02
        assert line.points > 100


def test_the_two_faces_of_a_thin_wall_stay_two() -> None:
    """A wall 8 cm thick, seen from either side: two faces, not one line between them."""
    beams = []
    for number, (y_m, heading) in enumerate([(-1.0, 90), (1.08, -90), (-1.2, 90), (1.28, -90)]):
        bearings = np.radians(np.arange(-60.0, 60.5, 1.0))
        near_m = -y_m if y_m < 0.0 else y_m - 0.08
        pose = SE2(0.0, y_m, math.radians(heading))
        beams.append(
            Beam(
                number=number,
                t_ns=number,
                sensor="l",
                layer="l",
                world_from_base=pose,
                world_from_sensor=pose,
                bearings_rad=bearings,
                ranges_m=near_m / np.cos(bearings),
                beam_width_rad=0.01,
                reach_m=30.0,
            )
        )
    found = segments_of_scans(beams, SECTION, layer="l")
    assert sorted(round(line.start_m[1], 3) for line in found) == [0.0, 0.08]


def test_what_one_scan_alone_saw_is_left_out() -> None:
    random = np.random.default_rng(3)
    beams = [scan_of_rectangle(i, SE2(3.0, 2.0, 0.1 * i), 0.003, random) for i in range(6)]
    moved = beams[2]
    ranges = moved.ranges_m.copy()
    ranges[250:290] = 0.6 / np.cos(moved.bearings_rad[250:290] - moved.bearings_rad[270])
    passing = Beam(**{
        name: ranges if name == "ranges_m" else getattr(moved, name)
        for name in Beam.__dataclass_fields__
    })  # fmt: skip
    found = segments_of_scans([*beams[:2], passing, *beams[3:]], SECTION, layer="lidar")
    near = [line for line in found if math.hypot(line.start_m[0] - 3, line.start_m[1] - 2) < 1.0]
    assert near == []
    assert segments_of_scans([], SECTION, layer="lidar") == []
