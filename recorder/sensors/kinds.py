"""What an entry of the catalogue holds: all that is known of one kind of sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorder.geometry import IDENTITY, SE2
from recorder.messages import Radiation, Range

BEYOND = "infrared above "  # and its limit: why a reading was dropped at an import
_MEDIUM = {
    Radiation.ULTRASOUND: "sonar", Radiation.INFRARED: "infrared", Radiation.LASER: "laser",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class SensorParameters:
    """Full width of the beam, and the ranges that the sensor can measure."""

    beam_width_rad: float
    min_range_m: float
    max_range_m: float
    radiation: Radiation

    def reading(self, t_ns: int, name: str, range_m: float) -> Range:
        """What the sensor ``name``, which is like that, measured."""
        return Range(
            t_ns, name, range_m, self.beam_width_rad, self.min_range_m, self.max_range_m,
            self.radiation,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class ScanPattern:
    """The beams of one scan, from right to left; ``reach_m`` is the farthest of a simulated one."""

    beams: int
    first_deg: float
    increment_deg: float
    reach_m: float

    @property
    def bearings_rad(self) -> NDArray[np.float64]:
        """Direction of each beam relative to the sensor, (N,)."""
        bearings_deg = self.first_deg + self.increment_deg * np.arange(self.beams)
        return np.asarray(np.radians(bearings_deg), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults:
    """How a kind misbehaves; the simulator scales all of it but the two last by its ``noise``.

    ``error`` and ``error_m`` are standard deviations, relative and absolute. ``aim_deg`` is how far
    the beam of a light wavers, ``average_deg`` how wide a cone is averaged to one range.
    ``short_share`` and ``lost_share`` count the echoes that come too early or not at all. A sensor
    that ``clips`` reports its least range for all that is nearer; its ranges are whole multiples
    of ``resolution_m`` (0: as fine as the protocol). A sensor with an analogue output gives
    ``volts_m`` / range volts (0: it is digital), which a converter reads in steps; nearer than 0.6
    of its least range the voltage falls again.
    """

    error: float = 0.0
    error_m: float = 0.0
    aim_deg: float = 0.0
    average_deg: float = 0.0
    short_share: float = 0.0
    lost_share: float = 0.0
    clips: bool = False
    resolution_m: float = 0.0
    volts_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorKind:
    """One entry of the catalogue. Names in ``sources`` are those of the fields, with spaces
    between; each is where their numbers come from.

    ``range_error`` is relative, and what the chapter's models take; ``model`` and ``parameters``
    are the sensor model that suits the kind and its numbers by name, which the mapping checks;
    ``update`` is the update rule that suits them (docs/rules.md tells why).
    ``no_echo`` is what a reading without an obstacle does to the map. ``invalid_m`` are ranges
    that stand for "no valid reading". ``mount`` is where the sensor sits unless the session or the
    configuration places it.
    """

    name: str
    title: str
    radiation: Radiation
    beam_width_deg: float
    min_range_m: float
    max_range_m: float
    range_error: float
    rate_hz: float
    model: str
    model_parameters: Mapping[str, float]
    no_echo: str
    faults: Faults
    sources: Mapping[str, str]
    update: str = "bayes"
    mount: SE2 = IDENTITY
    scan: ScanPattern | None = None
    invalid_m: tuple[float, ...] = ()
    aliases: tuple[str, ...] = ()
    remark: str = ""

    @property
    def parameters(self) -> SensorParameters:
        """What each of its readings carries."""
        return SensorParameters(
            math.radians(self.beam_width_deg), self.min_range_m, self.max_range_m, self.radiation
        )

    @property
    def medium(self) -> str:
        """``sonar``, ``infrared`` or ``laser``, and whether it scans."""
        return _MEDIUM[self.radiation] + (", scans" if self.scan else "")

    def misread(self, range_m: float) -> str:
        """Why a range is a glitch of this kind, in centimetres; empty where it is none."""
        if range_m in self.invalid_m:
            return f"invalid {100.0 * range_m:g}"
        if self.radiation is Radiation.INFRARED and range_m > self.max_range_m:
            return f"{BEYOND}{100.0 * self.max_range_m:g} cm"
        return ""

    def summary(self) -> str:
        """The entry in a few numbers, for people."""
        return (
            f"{self.title}: {self.medium}, {self.beam_width_deg:g} degrees, "
            f"{self.min_range_m:g} to {self.max_range_m:g} m, +-{100.0 * self.range_error:g} %"
        )


def fading_light(range_error: float) -> dict[str, float]:
    """Parameters of the model ``fading`` for a thin beam of light: a band half as wide again as the
    range error on either side, believed at any range (tuned on simulated rooms)."""
    band = round(1.5 * range_error, 6)
    return {"hit": 2.2, "miss": 0.85, "near": 0.0, "before": band, "behind": band, "fade_m": 1e9}


# The same for a cone of sound: the wall lies on the arc or behind it, and far echoes count less.
FADING_SOUND: Mapping[str, float] = {
    "hit": 0.8, "miss": 0.08, "near": 30.0, "before": 0.01, "behind": 0.1, "fade_m": 0.75,
}  # fmt: skip
