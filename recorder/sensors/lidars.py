"""2D lidars: a scan is one reading of many beams."""

from __future__ import annotations

from functools import partial

from recorder.messages import Radiation
from recorder.sensors.kinds import Faults, ScanPattern, SensorKind, fading_light

_lidar = partial(
    SensorKind, radiation=Radiation.LASER, beam_width_deg=1.0, range_error=0.01, model="fading",
    model_parameters=fading_light(0.01), no_echo="empties",
)  # fmt: skip
_MODEL = {
    "model_parameters": "those of an infrared ranger, the band by the range error",
    "update": "`pooled` has no fast way for scans, which are hundreds of beams each",
}

KINDS = (
    _lidar(
        name="lidar",
        title="a 2D lidar",
        min_range_m=0.05,
        max_range_m=30.0,
        rate_hz=5.0,
        scan=ScanPattern(360, -180.0, 1.0, 12.0),
        faults=Faults(error_m=0.01),
        sources={
            **_MODEL,
            "beam_width_deg": "of a scan its own increment; 1 degree where it has none",
            "min_range_m max_range_m range_error faults": "a usual indoor lidar: 1 %, 1 cm",
            "rate_hz scan": "the simulated lidar: a degree apart, up to 12 m",
        },
    ),
    _lidar(
        name="rplidar_a1",
        title="Slamtec RPLIDAR A1",
        aliases=("rplidar", "rplidar_a1m8"),
        min_range_m=0.15,
        max_range_m=12.0,
        rate_hz=5.5,
        scan=ScanPattern(360, -180.0, 1.0, 12.0),
        faults=Faults(error=0.005, error_m=0.001),
        sources={
            **_MODEL,
            "beam_width_deg rate_hz scan": "data sheet LD108: 1 degree at 5.5 scans a second",
            "min_range_m max_range_m": "data sheet: 0.15 to 12 m on white",
            "range_error faults": "data sheet: resolution below 1 % of the distance, 0.5 mm near",
        },
        remark="It turns clockwise and counts so; its ROS driver gives scans counter-clockwise.",
    ),
)
