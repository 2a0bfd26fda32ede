"""What can be wrong with a run: faults that are planted for whoever looks for them.

They come on top of what every sensor does (``noise``), and none of them is in what the session
states: its mounts, fields of view and stamps are those of a robot without them. Each draws from
random numbers of its own, so that a fault changes nothing but what it says.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields

import numpy as np

from recorder.errors import BadInput
from recorder.geometry import IDENTITY, SE2
from recorder.names import did_you_mean
from recorder.sensors import SensorKind

WHEEL_SLIP = 0.02  # of the way rolled between two readings of the counters, with noise 1
_LIMITS = {  # of a sensor's faults
    "scale": (0.1, 10.0), "bias_m": (-10.0, 10.0), "delay_s": (-10.0, 10.0),
    "beam_width_deg": (0.01, 180.0), "lost": (0.0, 1.0), "random": (0.0, 1.0),
}  # fmt: skip
_RUN_LIMITS = {
    "pose_delay_s": (-10.0, 10.0), "pose_noise_m": (0.0, 10.0), "pose_noise_deg": (0.0, 180.0),
    "pose_drift_mpmin": (0.0, 10.0), "pose_drift_degpmin": (-360.0, 360.0),
    "heading_bias_deg": (-180.0, 180.0), "wheel_slip": (0.0, 1.0), "cross_talk": (0.0, 1.0),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorFaults:
    """What is wrong with one sensor.

    ``mount`` is where it truly sits, seen from where the session states it. A range r is reported
    as r · ``scale`` + ``bias_m``. It was measured ``delay_s`` before its stamp. ``beam_width_deg``
    is its true cone (None: the stated one). ``lost`` and ``random`` are shares of the readings
    without echo, and of those that are any range at all. ``stuck_s`` and ``dead_s`` are stretches
    (from, to) in which it repeats its last range, or is silent. Its readings come under the name
    ``reports_as``: the channels of two sensors are swapped.
    """

    mount: SE2 = IDENTITY
    scale: float = 1.0
    bias_m: float = 0.0
    delay_s: float = 0.0
    beam_width_deg: float | None = None
    lost: float = 0.0
    random: float = 0.0
    stuck_s: tuple[float, float] | None = None
    dead_s: tuple[float, float] | None = None
    reports_as: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFaults:
    """What is wrong with a whole run.

    A pose shows where the robot was ``pose_delay_s`` before its stamp. Every pose is off by
    ``pose_noise_m`` and ``pose_noise_deg`` (standard deviations, each pose on its own), and all
    drift by ``pose_drift_mpmin`` metres a minute in one direction and ``pose_drift_degpmin``
    degrees; headings are ``heading_bias_deg`` too large. ``cross_talk`` is the share of the pings
    in which a sonar also receives the echoes of the others' pings.
    """

    pose_delay_s: float = 0.0
    pose_noise_m: float = 0.0
    pose_noise_deg: float = 0.0
    pose_drift_mpmin: float = 0.0
    pose_drift_degpmin: float = 0.0
    heading_bias_deg: float = 0.0
    wheel_slip: float = WHEEL_SLIP
    cross_talk: float = 0.0
    sensors: Mapping[str, SensorFaults] = field(default_factory=dict)

    def of(self, sensor: str) -> SensorFaults:
        """What is wrong with a sensor, by its name."""
        return self.sensors.get(sensor, SOUND_SENSOR)

    def stated(self) -> dict[str, str]:
        """What differs from a sound robot, as text by name: ``ping.bias_m`` → ``0.03``."""
        found = _differences(self, SOUND, "")
        for name, faults in self.sensors.items():
            found.update(_differences(faults, SOUND_SENSOR, f"{name}."))
        return found


SOUND_SENSOR = SensorFaults()
SOUND = RunFaults()


def check_faults(faults: RunFaults, sensors: Mapping[str, SensorKind]) -> None:
    """Raises BadInput for a fault of a sensor that there is not, and for numbers out of bounds."""
    _check_bounds(faults, _RUN_LIMITS, "")
    for name, of_sensor in faults.sensors.items():
        for known in (name, of_sensor.reports_as or name):
            if known not in sensors:
                hint = did_you_mean(known, sensors)
                raise BadInput(f"a fault of {known!r}, which the robot does not have; {hint}")
        _check_bounds(of_sensor, _LIMITS, f"{name}: ")
        if of_sensor.reports_as and sensors[of_sensor.reports_as].scan != sensors[name].scan:
            raise BadInput(f"{name} and {of_sensor.reports_as} cannot be swapped: one is a laser")


def spoiled(
    range_m: float, faults: SensorFaults, kind: SensorKind, rng: np.random.Generator
) -> float:
    """A range as the faulty sensor reports it; ±Inf as for a sound one."""
    lost, is_random, anywhere = rng.random(3)
    if lost < faults.lost:
        return math.inf
    if is_random < faults.random:
        return kind.min_range_m + float(anywhere) * (kind.max_range_m - kind.min_range_m)
    if not math.isfinite(range_m):
        return range_m
    range_m = range_m * faults.scale + faults.bias_m
    if range_m > kind.max_range_m:
        return math.inf
    return range_m if range_m >= kind.min_range_m else -math.inf


def holds_at(stretch_s: tuple[float, float] | None, t_s: float) -> bool:
    """Whether a time lies in a stretch."""
    return stretch_s is not None and stretch_s[0] <= t_s < stretch_s[1]


def _check_bounds(
    faults: SensorFaults | RunFaults, limits: Mapping[str, tuple[float, float]], of: str
) -> None:
    for name, (lowest, highest) in limits.items():
        value = getattr(faults, name)
        if value is not None and not lowest <= value <= highest:
            what = name.replace("_", " ")
            raise BadInput(f"{of}the {what} must be {lowest:g} to {highest:g}, not {value:g}")


def _differences(
    faults: SensorFaults | RunFaults, sound: SensorFaults | RunFaults, prefix: str
) -> dict[str, str]:
    found = {}
    for each in fields(faults):
        value = getattr(faults, each.name)
        if each.name == "sensors" or value == getattr(sound, each.name):
            continue
        shown = list(asdict(value).values()) if isinstance(value, SE2) else value
        found[prefix + each.name] = str(shown)
    return found
