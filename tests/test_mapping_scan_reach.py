"""How far beams clear: a room with a window, and limits of one's own."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from naive_live_placing import LivePlacer
from naive_placing import place

from mapping.artifacts import Segment, Snapshot, Started, TempGrid
from mapping.beams import Beam
from mapping.config import load_config
from mapping.pipeline import build_maps
from mapping.scan_reach import ScanReach
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range, Scan

NS = 1_000_000_000
WIDTH_M, HEIGHT_M = 12.0, 8.0
WINDOW_Y_M = (3.0, 5.0)  # in the wall x = WIDTH_M
COARSE = "grid.resolution_m=0.05"
STOPS = [SE2(2.0 + 0.4 * k, 2.0 + 0.2 * k, 0.3 * k) for k in range(20)]


def seen_from(pose: SE2, count: int = 360, noise_m: float = 0.0, seed: int = 0) -> np.ndarray:
    """Ranges to the nearest wall of the room at one degree each; +Inf through the window."""
    angles = pose.heading_rad + np.radians(np.arange(count) - 180.0)
    dx, dy = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        x = np.where(dx > 0.0, (WIDTH_M - pose.x_m) / dx, pose.x_m / np.abs(dx))
        y = np.where(dy > 0.0, (HEIGHT_M - pose.y_m) / dy, pose.y_m / np.abs(dy))
    ranges = np.minimum(x, y)
    through = (x < y) & (dx > 0.0)
    at_y = pose.y_m + ranges * dy
    window = through & (at_y > WINDOW_Y_M[0]) & (at_y < WINDOW_Y_M[1])
    noisy = ranges + noise_m * np.random.default_rng(seed).standard_normal(count)
    return np.where(window, np.inf, noisy)


def session(stops: list[SE2] = STOPS, noise_m: float = 0.0) -> list[Message]:
    out: list[Message] = []
    for k, pose in enumerate(stops):
        out.append(Pose(k * NS // 5, pose))
        ranges = seen_from(pose, noise_m=noise_m, seed=k)
        step = math.radians(1.0)
        out.append(Scan(k * NS // 5, "lidar", ranges, -math.pi, step, 0.05, 30.0))
    return out


def free_beyond_m(*settings: str) -> float:
    """How far outside of the window the map is free, metres; 0: nowhere."""
    artifacts = list(build_maps(session(), load_config(settings=[COARSE, *settings])))
    (started,) = [a for a in artifacts if isinstance(a, Started)]
    (final,) = [a for a in artifacts if isinstance(a, Snapshot) and a.final]
    free = np.argwhere((final.layer.probability < 0.4) & final.layer.observed)
    beyond = started.geometry.centres_of(free)[:, 0] - WIDTH_M
    return max(float(beyond.max()), 0.0)


def test_a_window_paints_no_farther_than_the_walls_beside_it() -> None:
    assert free_beyond_m() < 1.5
    assert free_beyond_m("sensors.lidar.clear_to_m=30") > 10.0


def test_a_limit_of_ones_own_holds_for_every_beam() -> None:
    settings = [COARSE, "sensors.lidar.clear_to_m=1.5"]
    grids = [
        a for a in build_maps(session(), load_config(settings=settings)) if isinstance(a, TempGrid)
    ]
    for grid in grids:
        at = grid.beam.world_from_sensor
        cells = np.argwhere(grid.free) + np.array([grid.window.row0, grid.window.col0])
        away = grid.geometry.centres_of(cells) - (at.x_m, at.y_m)
        assert np.hypot(*away.T).max() == pytest.approx(1.5, abs=0.08)
        assert np.isclose(grid.probability[~grid.free & ~grid.band], 0.5).all()
        assert grid.band.sum() > 100  # walls farther away are walls


def test_a_ranger_clears_no_farther_than_it_may() -> None:
    """Neither where nothing came back nor in front of what did."""
    poses = [Pose(k * NS // 5, SE2(0.0, 0.0, 0.0)) for k in range(2)]
    readings = [
        Range(k * NS // 5, "tof", range_m, 0.1, 0.05, 4.0, Radiation.INFRARED)
        for k, range_m in enumerate([math.inf, 3.0])
    ]
    mixed = [m for pair in zip(poses, readings, strict=True) for m in pair]
    limits = [
        "sensors.tof.clear_to_m=1",
        "sensors.tof.no_echo=empties",
        "sensors.tof.mount=[0,0,0]",
    ]
    for rasteriser, limited in itertools.product(["cells", "arcs"], [True, False]):
        settings = [COARSE, f"sensors.tof.rasteriser={rasteriser}", *limits[0 if limited else 1 :]]
        artifacts = build_maps(mixed, load_config(settings=settings))
        empty, seen = [a for a in artifacts if isinstance(a, TempGrid)]
        for grid, whole_m in ((empty, 4.0), (seen, 2.7)):
            cells = np.argwhere(grid.free) + np.array([grid.window.row0, grid.window.col0])
            far_m = grid.geometry.centres_of(cells)[:, 0].max()
            if limited:
                assert far_m == pytest.approx(1.0, abs=0.06)
            else:
                assert far_m > whole_m - 0.3
        assert seen.band.any()


def test_a_live_map_places_the_same_beams() -> None:
    messages, config = session(), load_config()
    live = LivePlacer(config)
    beams: list[Beam] = []
    for message in messages:
        beams += live.take(message)
    beams += live.finish()
    wanted = place(messages, config).beams
    assert len(beams) == len(wanted) == len(STOPS)
    for a, b in zip(beams, wanted, strict=True):
        np.testing.assert_array_equal(a.reach_m, b.reach_m)


def test_a_scan_without_any_return_clears_nothing() -> None:
    (sensor,) = place(session(), load_config()).sensors.values()
    nothing = np.full(8, np.inf)
    bearings = np.linspace(-1.0, 1.0, 8)
    assert not ScanReach().of_scan(SE2(0.0, 0.0, 0.0), bearings, nothing, sensor).any()


@pytest.mark.parametrize("resolution_m", [0.02, 0.05])
def test_lines_of_a_lidar_lie_within_two_cells_of_the_wall(resolution_m: float) -> None:
    """One a wall, with a centimetre of noise; of 5 cm cells the median is half a cell."""
    settings = [f"grid.resolution_m={resolution_m}"]
    messages = session(noise_m=0.01)
    segments = [
        a for a in build_maps(messages, load_config(settings=settings)) if isinstance(a, Segment)
    ]
    for source in ("grid", "raw"):
        lines = [s for s in segments if s.source == source]
        ends = [np.array([s.start_m, s.end_m]) for s in lines]
        off_m = [
            min(np.abs(e - wall).max() for e, wall in (
                (end[:, 0], 0.0), (end[:, 0], WIDTH_M), (end[:, 1], 0.0), (end[:, 1], HEIGHT_M),
            )) for end in ends
        ]  # fmt: skip
        assert max(off_m) < (2.0 * 0.05 if source == "grid" else 0.02)
        lengths = [float(np.hypot(*(end[1] - end[0]))) for end in ends]
        walls_m = 2.0 * (WIDTH_M + HEIGHT_M) - (WINDOW_Y_M[1] - WINDOW_Y_M[0])
        assert sum(lengths) == pytest.approx(walls_m, rel=0.06)
        assert len(lines) == 5  # the window cuts a wall in two
