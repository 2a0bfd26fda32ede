"""Rangers that time light: ROS reports them as infrared; their reach is that of a sonar."""

from __future__ import annotations

from functools import partial

from recorder.messages import Radiation
from recorder.sensors.kinds import Faults, ScanPattern, SensorKind, fading_light

_timed = partial(
    SensorKind, radiation=Radiation.INFRARED, model="fading", no_echo="empties",
)  # fmt: skip
_MODEL = {
    "model_parameters": "those of an infrared ranger, the band by the range error",
    "update": "as of an infrared ranger; in a wide cone `pooled` frees walls (simulated rooms)",
}
_WIDE = "It reports one range for all that its cone meets: an edge reads somewhere between."

KINDS = (
    _timed(
        name="vl53l0x",
        title="ST VL53L0X",
        beam_width_deg=25.0,
        min_range_m=0.05,
        max_range_m=2.0,
        range_error=0.04,
        rate_hz=30.0,
        model_parameters=fading_light(0.04),
        invalid_m=(8.19, 8.191),
        faults=Faults(error=0.03, average_deg=25.0, resolution_m=0.001),
        sources={
            **_MODEL,
            "beam_width_deg max_range_m": "data sheet DS11555: 25 degrees, up to 2 m",
            "min_range_m": "assumed: below it ranges bend",
            "range_error faults": "data sheet: 3 to 4 % on white indoors, in 33 ms",
            "rate_hz": "data sheet: 33 ms a measurement",
            "invalid_m": "ST's library: 8190 or 8191 mm where there is no target",
        },
        remark=_WIDE,
    ),
    _timed(
        name="vl53l1x",
        title="ST VL53L1X",
        beam_width_deg=27.0,
        min_range_m=0.04,
        max_range_m=4.0,
        range_error=0.02,
        rate_hz=20.0,
        model_parameters=fading_light(0.02),
        invalid_m=(8.191,),
        faults=Faults(error=0.005, error_m=0.01, average_deg=27.0, resolution_m=0.001),
        sources={
            **_MODEL,
            "beam_width_deg min_range_m max_range_m": "data sheet DS12385: 27 degrees, 4 cm to 4 m",
            "range_error faults": "data sheet: 20 mm, taken at 1 m",
            "rate_hz": "ST's ultra light driver: 50 ms a measurement",
            "invalid_m": "ST: 8192 less the status where there is no target",
        },
        remark=_WIDE,
    ),
    _timed(
        name="vl53l5cx",
        title="ST VL53L5CX",
        radiation=Radiation.LASER,
        beam_width_deg=5.625,
        min_range_m=0.02,
        max_range_m=4.0,
        range_error=0.05,
        rate_hz=15.0,
        model_parameters=fading_light(0.05),
        scan=ScanPattern(8, -19.6875, 5.625, 4.0),
        faults=Faults(error=0.03, error_m=0.01, resolution_m=0.001),
        sources={
            **_MODEL,
            "beam_width_deg scan": "data sheet DS13754: 45 degrees in 8 x 8 zones",
            "min_range_m max_range_m": "data sheet: 2 cm to 4 m",
            "range_error faults": "data sheet: 5 % beyond 20 cm, 15 mm below, inner zones",
            "rate_hz": "data sheet: 15 times a second with 8 x 8 zones",
        },
        remark="Its zones are one scan of 8 beams: of each column the nearest of the 8 zones.",
    ),
    _timed(
        name="tfluna",
        title="Benewake TF-Luna",
        aliases=("tf_luna",),
        beam_width_deg=2.0,
        min_range_m=0.2,
        max_range_m=8.0,
        range_error=0.04,
        rate_hz=100.0,
        model_parameters=fading_light(0.04),
        faults=Faults(error=0.003, error_m=0.01, resolution_m=0.01),
        sources={
            **_MODEL,
            "beam_width_deg rate_hz": "manual SJ-PM-TF-Luna: 2 degrees, 100 Hz",
            "min_range_m max_range_m": "manual: 0.2 to 8 m on white (2.5 m on black)",
            "range_error": "manual: 6 cm below 3 m (4 % at 1.5 m), 2 % beyond",
            "faults": "manual: standard deviation 0.5 cm at 2 m, 2 cm at 8 m; whole centimetres",
        },
        remark="Where too little light returns (black, glass), it is unreliable or reports 0.",
    ),
    _timed(
        name="tfmini",
        title="Benewake TFmini",
        beam_width_deg=2.3,
        min_range_m=0.3,
        max_range_m=12.0,
        range_error=0.02,
        rate_hz=100.0,
        model_parameters=fading_light(0.02),
        faults=Faults(error=0.005, error_m=0.01, resolution_m=0.01),
        sources={
            **_MODEL,
            "beam_width_deg rate_hz": "data sheet SJ-GU-TFmini-01: 2.3 degrees, 100 Hz",
            "min_range_m max_range_m": "data sheet: 0.3 to 12 m on white (5 m on black)",
            "range_error": "data sheet: 1 % below 6 m, 2 % beyond",
            "faults": "assumed: half the error of the data sheet; whole centimetres",
        },
        remark="Nearer than 0.3 m its readings are not to be trusted.",
    ),
)
