"""What a robot measures, as frozen values in SI units, radians and nanoseconds, as the names show.

Every message carries ``t_ns``, the estimated time of measurement in UNIX nanoseconds. When it
reached the host is kept beside it, in :class:`Record`.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from recorder.geometry import SE2

MAP_FRAME = "map"
ODOM_FRAME = "odom"
BASE_FRAME = "base_link"
HEAD_FRAME = "head"


class Radiation(enum.IntEnum):
    """What a ranger sends out; the numbers are those of ROS sensor_msgs/Range (laser is ours)."""

    ULTRASOUND = 0
    INFRARED = 1
    LASER = 2


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the robot stands in the ``map`` frame, from an overhead tracker or another source."""

    t_ns: int
    world_from_base: SE2


@dataclass(frozen=True, slots=True)
class Odometry:
    """Where dead reckoning thinks that the robot stands, in the ``odom`` frame."""

    t_ns: int
    odom_from_base: SE2


@dataclass(frozen=True, slots=True)
class Range:
    """One reading of one ranger. +Inf: nothing seen; -Inf: too close (ROS REP 117).

    ``frame`` is where it was measured, if that is not called as the sensor is.
    """

    t_ns: int
    sensor: str
    range_m: float
    beam_width_rad: float
    min_range_m: float
    max_range_m: float
    radiation: Radiation
    frame: str = ""


@dataclass(frozen=True, slots=True)
class Scan:
    """One sweep of a 2D lidar: ``ranges_m`` (N,) at ``angle_min_rad + i * angle_increment_rad``.

    ``frame`` is as of :class:`Range`.
    """

    t_ns: int
    sensor: str
    ranges_m: NDArray[np.float64]
    angle_min_rad: float
    angle_increment_rad: float
    min_range_m: float
    max_range_m: float
    frame: str = ""


@dataclass(frozen=True, slots=True)
class Transform:
    """Where frame ``child`` stands in frame ``parent``: a mount (static) or a turning head.

    ``up`` is the share of the child's z axis along the parent's: 1 where both are level, -1 where
    the child hangs upside down.
    """

    t_ns: int
    parent: str
    child: str
    parent_from_child: SE2
    static: bool = True
    up: float = 1.0


@dataclass(frozen=True, slots=True)
class RawLine:
    """A line of the serial link as it came, good or bad (bytes as Latin-1 text)."""

    t_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class Diagnostics:
    """Counters of the recorder: received, bad checksum, gaps, reconnects, written."""

    t_ns: int
    name: str
    counters: Mapping[str, int | float | str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class OccupancyGrid:
    """A map for other programs: ``percent`` int8 (rows, cols), 0 .. 100 occupied, -1 unknown.

    Row 0 lies at the lowest y; ``origin_m`` is the outer corner of cell (0, 0) in the map frame.
    """

    t_ns: int
    layer: str
    origin_m: tuple[float, float]
    resolution_m: float
    percent: NDArray[np.int8]


@dataclass(frozen=True, slots=True)
class Path:
    """The way of the robot, as one message: poses in the map frame with their times."""

    t_ns: int
    poses: tuple[Pose, ...]


Message = Pose | Odometry | Range | Scan | Transform | RawLine | Diagnostics | OccupancyGrid | Path


@dataclass(frozen=True, slots=True)
class Record:
    """A message as it stands in a session: on which topic, and when it reached the host."""

    topic: str
    log_ns: int
    message: Message


def topic_of(message: Message) -> str:
    """The topic on which a message of our own is written."""
    match message:
        case Pose():
            return "/pose"
        case Odometry():
            return "/odom"
        case Range():
            return f"/range/{message.sensor}"
        case Scan():
            return f"/scan/{message.sensor}"
        case Transform():
            return "/tf_static" if message.static else "/tf"
        case RawLine():
            return "/serial/raw"
        case Diagnostics():
            return "/diagnostics"
        case OccupancyGrid():
            return f"/map/{message.layer}"
        case Path():
            return "/path"
