"""What must be known of a robot before it is recorded, and how it is written on a command line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from recorder.errors import BadInput
from recorder.geometry import SE2, wrap_angle
from recorder.messages import BASE_FRAME, Radiation, Transform
from recorder.names import FRAME_NAME, did_you_mean
from recorder.odometry import WheelGeometry
from recorder.sensors import CATALOGUE, SensorParameters
from recorder.session import Limits


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """How a line is recorded, but for where it is and where the session goes.

    ``protocol`` is a name or a Python file, ``columns`` those of ``csv``; ``baud`` is the
    protocol's own unless given. ``walls`` are kept as an attachment (GeoJSON).
    """

    protocol: str = "echogrid"
    columns: str | None = None
    baud: int | None = None
    tracker: str | None = None
    px_per_m: float | None = None
    duration_s: float | None = None
    mounts: tuple[Transform, ...] = ()
    sensors: Mapping[str, SensorParameters] = field(default_factory=dict)
    wheels: WheelGeometry | None = None
    walls: bytes | None = None
    source_name: str = ""  # what the session calls the source, when not as it is opened
    source_damage: tuple[str, ...] = ()  # what cannot be read of a session that is played again
    limits: Limits = field(default_factory=Limits)
    force: bool = False


def parse_wheels(text: str) -> WheelGeometry:
    """``RADIUS_M,TRACK_M,COUNTS_PER_TURN`` → geometry. Raises BadInput in one line."""
    radius_m, track_m, counts_per_turn = _numbers(
        text, f"--wheels {text}", "--wheels RADIUS_M,TRACK_M,COUNTS"
    )
    if min(radius_m, track_m, counts_per_turn) <= 0.0:
        raise BadInput(f"--wheels {text}: all three must be above zero")
    return WheelGeometry(counts_per_turn / (2.0 * math.pi * radius_m), track_m)


def parse_pose(text: str) -> SE2:
    """``X_M,Y_M,DEG`` → where a robot stands. Raises BadInput in one line."""
    x_m, y_m, heading_deg = _numbers(text, f"--pose {text}", "--pose X,Y,DEG")
    return SE2(x_m, y_m, wrap_angle(math.radians(heading_deg)))


def parse_mount(text: str) -> Transform:
    """``NAME=X_M,Y_M,DEG``, or ``NAME@FRAME=...`` on a turning head → where a sensor sits.

    Raises BadInput in one line.
    """
    wanted = "--mount NAME=X_M,Y_M,DEG"
    frames, separator, numbers = text.partition("=")
    name, _, parent = frames.partition("@")
    parent = parent or BASE_FRAME
    if not separator:
        raise BadInput(f"--mount {text}: {wanted} is wanted")
    for each in (name, parent):
        _check_name(each, f"--mount {text}")
    x_m, y_m, yaw_deg = _numbers(numbers, f"--mount {text}", wanted)
    return Transform(0, parent, name, SE2(x_m, y_m, math.radians(yaw_deg)))


def parse_sensor(text: str) -> tuple[str, SensorParameters]:
    """``NAME=KIND``, or ``NAME=BEAM_DEG,MIN_M,MAX_M`` and ``,ir`` for infrared → what it is.

    Raises BadInput in one line.
    """
    wanted = "--sensor NAME=KIND or NAME=BEAM_DEG,MIN_M,MAX_M[,ir]"
    name, _, what = text.partition("=")
    if not what:
        raise BadInput(f"--sensor {text}: {wanted} is wanted")
    _check_name(name, f"--sensor {text}")
    if what in CATALOGUE:
        return name, CATALOGUE[what].parameters
    if what[0].isalpha():
        raise BadInput(f"--sensor {text}: no kind {what!r}; {did_you_mean(what, CATALOGUE)}")
    numbers = what.removesuffix(",ir")
    radiation = Radiation.ULTRASOUND if numbers == what else Radiation.INFRARED
    beam_deg, min_m, max_m = _numbers(numbers, f"--sensor {text}", wanted)
    if not (0.0 < beam_deg <= 360.0 and 0.0 <= min_m < max_m):
        raise BadInput(
            f"--sensor {text}: no sensor is like that: BEAM_DEG is above 0 and at most 360, "
            "MIN_M is below MAX_M"
        )
    return name, SensorParameters(math.radians(beam_deg), min_m, max_m, radiation)


def _check_name(name: str, given: str) -> None:
    if not FRAME_NAME.fullmatch(name):
        raise BadInput(
            f"{given}: {name!r} is no name; one begins with a letter and goes on with letters, "
            "digits and _, 32 at most"
        )


def _numbers(text: str, given: str, wanted: str) -> list[float]:
    """Three of them; ``given`` is what the user wrote, ``wanted`` what it should be like."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(math.isfinite(number) for number in numbers):
        raise BadInput(f"{given}: {text!r} is not three numbers; {wanted} is wanted")
    return numbers
