"""Infrared rangers that triangulate: a thin beam, a short reach, and no use below their least.

Nearer than that their curve turns back, so that a near thing reads as a far one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from recorder.geometry import SE2
from recorder.messages import Radiation
from recorder.sensors.kinds import Faults, SensorKind, fading_light

_USUAL = Faults(error=0.03, aim_deg=0.5)
_triangulating = partial(
    SensorKind, radiation=Radiation.INFRARED, beam_width_deg=6.0, range_error=0.05, model="fading",
    model_parameters=fading_light(0.05), no_echo="empties",
    faults=_USUAL,
)  # fmt: skip
_SHARED = {
    "model_parameters": "tuned on simulated rooms",
    "update": "by the score without truth on real drives along walls: `pooled` frees them",
    "faults": "a usual sensor: 3 %, half a degree",
}
_SHARP = {
    **_SHARED,
    "beam_width_deg range_error": "as of the DIRRS+, which reads such a detector",
    "faults": "a usual sensor: 3 %, half a degree; volts by the data sheet's curve, ten bits",
}
_TURNS_BACK = "Nearer than its least range its voltage falls again: near things read as far ones."

KINDS = (
    _triangulating(
        name="dirrs",
        title="DIRRS+",
        min_range_m=0.1,
        max_range_m=0.8,
        rate_hz=20.0,
        mount=SE2(-0.0312, 0.0, 0.0),
        invalid_m=(1.11,),
        sources={
            **_SHARED,
            "beam_width_deg range_error mount": "the course text",
            "min_range_m max_range_m": "the course text: 10 to 80 cm; outside it sees ghosts",
            "rate_hz invalid_m": "the course's robot, which reports 111 cm for no valid reading",
        },
    ),
    _triangulating(
        name="gp2y0a21",
        title="Sharp GP2Y0A21YK0F",
        aliases=("gp2y0a21yk", "gp2y0a21yk0f"),
        min_range_m=0.1,
        max_range_m=0.8,
        rate_hz=26.0,
        faults=replace(_USUAL, volts_m=0.24),
        sources={
            **_SHARP,
            "min_range_m max_range_m": "data sheet: 10 to 80 cm",
            "rate_hz": "data sheet: 38.3 ms a measurement",
        },
        remark=_TURNS_BACK,
    ),
    _triangulating(
        name="gp2y0a02",
        title="Sharp GP2Y0A02YK0F",
        aliases=("gp2y0a02yk", "gp2y0a02yk0f"),
        min_range_m=0.2,
        max_range_m=1.5,
        rate_hz=26.0,
        faults=replace(_USUAL, volts_m=0.50),
        sources={
            **_SHARP,
            "min_range_m max_range_m": "data sheet: 20 to 150 cm",
            "rate_hz": "data sheet: 38.3 ms a measurement",
        },
        remark=_TURNS_BACK,
    ),
    _triangulating(
        name="gp2y0a41",
        title="Sharp GP2Y0A41SK0F",
        aliases=("gp2y0a41sk", "gp2y0a41sk0f"),
        min_range_m=0.04,
        max_range_m=0.3,
        rate_hz=60.0,
        faults=replace(_USUAL, volts_m=0.115),
        sources={
            **_SHARP,
            "min_range_m max_range_m": "data sheet: 4 to 30 cm",
            "rate_hz": "data sheet: 16.5 ms a measurement",
        },
        remark=_TURNS_BACK,
    ),
)
