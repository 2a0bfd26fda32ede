"""Made sessions for the regression tests: a robot rounds a room, and odd things happen.

They follow from formulas alone, not from the simulator, so that they stay what they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from recorder.geometry import SE2
from recorder.messages import (
    BASE_FRAME,
    HEAD_FRAME,
    Diagnostics,
    Message,
    Odometry,
    Pose,
    Radiation,
    Range,
    RawLine,
    Scan,
    Transform,
)

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 50_000_000
_CORNERS = ((0.0, 0.0), (2.6, 0.0), (2.6, 1.2), (1.5, 1.2), (1.5, 2.0), (0.0, 2.0))
_BOX = ((0.9, 0.8), (1.2, 0.8), (1.2, 1.05), (0.9, 1.05))
WALLS_M = np.array([
    (shape[k], shape[(k + 1) % len(shape)]) for shape in (_CORNERS, _BOX) for k in range(len(shape))
])  # fmt: skip
_SONAR, _INFRARED = Radiation.ULTRASOUND, Radiation.INFRARED


def noise(k: int, scale: float) -> float:
    """Something from -scale to scale that looks like noise and is the same everywhere."""
    return scale * ((k * 7919 + 104_729) % 2_003 / 1_001.0 - 1.0)


def pose_at(k: float) -> SE2:
    """The robot's way: round the box, turning as it goes."""
    a = 2.0 * math.pi * k / 110.0
    return SE2(0.75 + 0.45 * math.cos(a), 0.95 + 0.6 * math.sin(a), a * 1.7 + 0.3)


def seen_from(x: float, y: float, heading_rad: float) -> float:
    """Distance to the nearest wall straight ahead, metres; +Inf where none is."""
    d = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    a, along = WALLS_M[:, 0] - (x, y), WALLS_M[:, 1] - WALLS_M[:, 0]
    cross = d[0] * along[:, 1] - d[1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0]) / cross
        u = (a[:, 0] * d[1] - a[:, 1] * d[0]) / cross
    hit = t[(t > 0) & (u >= 0) & (u <= 1)]
    return float(hit.min()) if hit.size else math.inf


def _ranger(
    k: int, name: str, mount: SE2, width_deg: float, low_m: float, high_m: float,
    radiation: Radiation,
) -> Range:  # fmt: skip
    eye = pose_at(k + 0.3) @ mount
    half = math.radians(width_deg) / 2.0
    rays = [seen_from(eye.x_m, eye.y_m, eye.heading_rad + s * half) for s in (-0.8, -0.4, 0, 0.4)]
    nearest = min(rays) * (1.0 + noise(k, 0.01))
    return Range(
        START_NS + round((k + 0.3) * PERIOD_NS), name, nearest if nearest < high_m else math.inf,
        math.radians(width_deg), low_m, high_m, radiation,
    )  # fmt: skip


@lru_cache
def two_rangers(readings: int = 80) -> tuple[Message, ...]:
    """A sonar and an infrared ranger, mounted, with a tracker and wheels that drift."""
    return tuple(_two_rangers(readings))


def _two_rangers(readings: int) -> Iterator[Message]:
    ping, dirrs = SE2(0.05, 0.0, 0.1), SE2(-0.03, 0.02, math.pi / 2)
    yield Transform(START_NS, BASE_FRAME, "ping", ping)
    yield Transform(START_NS, BASE_FRAME, "dirrs", dirrs)
    for k in range(readings):
        t_ns = START_NS + k * PERIOD_NS
        if k % 2 == 0:
            yield Pose(t_ns, pose_at(k))
        drift = SE2(0.001 * k, -0.0005 * k, 0.0007 * k)
        yield Odometry(t_ns, pose_at(0.0).inverse() @ pose_at(k) @ drift)
        yield _ranger(k, "ping", ping, 38.0, 0.02, 4.0, _SONAR)
        yield _ranger(k, "dirrs", dirrs, 6.0, 0.1, 0.8, _INFRARED)
    yield Pose(START_NS + readings * PERIOD_NS, pose_at(readings))


@lru_cache
def turning_head() -> tuple[Message, ...]:
    """Both rangers sit on a head that sweeps."""
    return tuple(_turning_head())


def _turning_head() -> Iterator[Message]:
    mount = SE2(0.04, 0.0, 0.0)
    yield Transform(START_NS, HEAD_FRAME, "ping", mount)
    yield Transform(START_NS, HEAD_FRAME, "dirrs", mount)
    for k in range(90):
        t_ns = START_NS + k * PERIOD_NS
        head = SE2(0.02, 0.0, 1.2 * math.sin(k / 9.0))
        yield Pose(t_ns, pose_at(k))
        if not 40 <= k < 55:  # then the head is not heard of for a while
            yield Transform(t_ns, BASE_FRAME, HEAD_FRAME, head, static=False)
        yield _ranger(k, "ping", head @ mount, 38.0, 0.02, 4.0, _SONAR)
        yield _ranger(k, "dirrs", head @ mount, 6.0, 0.1, 0.8, _INFRARED)


@lru_cache
def laser(beams: int = 60, scans: int = 10) -> tuple[Message, ...]:
    """Scans of a laser, some beams of which say nothing."""
    return tuple(_laser(beams, scans))


def _laser(beams: int, scans: int) -> Iterator[Message]:
    first, step = -math.pi, 2.0 * math.pi / beams
    for k in range(0, scans * 4, 4):
        here = pose_at(k)
        yield Pose(START_NS + k * PERIOD_NS, here)
        ranges = np.array([
            seen_from(here.x_m, here.y_m, here.heading_rad + first + i * step)
            * (1.0 + noise(k * beams + i, 0.004)) for i in range(beams)
        ])  # fmt: skip
        ranges[7::29] = (math.nan, 0.01, math.inf)[k // 4 % 3]
        yield Scan(START_NS + k * PERIOD_NS, "lidar", ranges, first, step, 0.05, 6.0)


@lru_cache
def odd() -> tuple[Message, ...]:
    """Readings, poses and mounts of all the kinds that no map should trust."""
    return tuple(_odd())


def _odd() -> Iterator[Message]:
    yield RawLine(START_NS, "$?\r\n")
    yield Diagnostics(START_NS, "recorder", {"received": 1})
    yield Transform(START_NS, BASE_FRAME, "ping_left", SE2(0.0, 0.05, 0.8))
    yield Transform(START_NS, "a", "b", SE2(1.0, 0.0, 0.0))
    yield Transform(START_NS, "b", "a", SE2(1.0, 0.0, 0.0))
    yield Transform(START_NS, "a", "ping3", SE2(0.0, 0.0, 0.0))
    yield Transform(START_NS, BASE_FRAME, "ping_left", SE2(math.nan, 0.05, 0.8))
    bad = (math.nan, -math.inf, math.inf, 0.0, -0.2, 0.005, 3.99, 4.0, 9.0, 0.02)
    for k in range(60):
        t_ns = START_NS + k * PERIOD_NS
        if not 20 < k < 36:
            yield Pose(t_ns, pose_at(k))
        if k in (5, 6):
            yield Pose(t_ns + 7, SE2(math.nan if k == 5 else 2e6, 0.0, 0.0))
        for name, angle in (("ping_left", 0.8), ("ping2", 0.0), ("ping3", 0.0)):
            reading = _ranger(k, name, SE2(0.0, 0.05, angle), 30.0, 0.02, 4.0, _SONAR)
            value = bad[k // 4 % len(bad)] if k % 4 == 0 else reading.range_m
            yield Range(
                reading.t_ns, name, value, reading.beam_width_rad, reading.min_range_m,
                reading.max_range_m, reading.radiation,
            )  # fmt: skip
        yield Range(t_ns, "sharp", 0.3 + noise(k, 0.2), math.nan, math.nan, 0.7, _INFRARED)
        yield _ranger(k, "dirrs_2", SE2(0.0, 0.0, 2.0), 6.0, 0.1, 0.8, _INFRARED)
        yield _ranger(k, "eye", SE2(0.0, 0.0, -2.0), 2.0, 0.1, 5.0, Radiation.LASER)


@lru_cache
def odometry_only() -> tuple[Message, ...]:
    """No tracker: the poses come from the wheels."""
    return tuple(m for m in two_rangers() if not isinstance(m, Pose))
