"""Sonars: what a cone of sound returns. The physics that they share is the simulator's."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from recorder.geometry import SE2
from recorder.messages import Radiation
from recorder.sensors.kinds import FADING_SOUND, Faults, SensorKind

_sonar = partial(
    SensorKind, radiation=Radiation.ULTRASOUND, model="fading", model_parameters=FADING_SOUND,
    update="pooled", no_echo="skipped",
)  # fmt: skip
_USUAL = Faults(error=0.01, error_m=0.005, short_share=0.02, lost_share=0.08)
_SHARED = {
    "model_parameters": "tuned on simulated rooms",
    "update": "scored best on simulated rooms, and on three of four real drives",
    "faults": "a usual cheap sonar: 1 % and 5 mm, 2 % too short, about a tenth without echo",
}
_SOUND = "the speed of sound, not corrected over 20 K (0.18 % a kelvin)"

KINDS = (
    _sonar(
        name="ping",
        title="Parallax PING)))",
        beam_width_deg=38.0,
        min_range_m=0.02,
        max_range_m=4.0,
        range_error=0.10,
        rate_hz=20.0,
        mount=SE2(0.044, 0.0, 0.0),
        invalid_m=(1.11,),
        faults=_USUAL,
        sources={
            **_SHARED,
            "beam_width_deg min_range_m max_range_m range_error mount": "the course text",
            "rate_hz invalid_m": "the course's robot, which reports 111 cm for no valid reading",
        },
    ),
    _sonar(
        name="hcsr04",
        title="HC-SR04",
        beam_width_deg=30.0,
        min_range_m=0.02,
        max_range_m=4.0,
        range_error=0.04,
        rate_hz=16.0,
        faults=replace(_USUAL, resolution_m=0.003),
        sources={
            **_SHARED,
            "beam_width_deg": "data sheet, ELEC Freaks: 15 degrees to either side",
            "min_range_m max_range_m": "data sheet: 2 cm to 4 m",
            "range_error": f"{_SOUND}; 3 mm by the data sheet",
            "rate_hz": "data sheet: a cycle of over 60 ms",
        },
        remark="Without echo its pulse lasts 38 ms, which reads as 6.5 m: beyond its limit.",
    ),
    _sonar(
        name="jsnsr04t",
        title="JSN-SR04T",
        beam_width_deg=75.0,
        min_range_m=0.20,
        max_range_m=6.0,
        range_error=0.04,
        rate_hz=10.0,
        faults=replace(_USUAL, error_m=0.01, resolution_m=0.001),
        sources={
            **_SHARED,
            "beam_width_deg": "data sheet, version 3.0: under 75 degrees",
            "min_range_m max_range_m": "data sheet, version 3.0: 20 to 600 cm (2.0: 25 to 450)",
            "range_error": f"{_SOUND}; 1 cm by the data sheet",
            "rate_hz": "data sheet: 100 ms in serial mode",
        },
        remark="Watertight; what is nearer than 20 cm reads as some other range.",
    ),
    _sonar(
        name="mb1010",
        title="MaxBotix LV-MaxSonar-EZ1 (MB1010)",
        aliases=("maxbotix", "maxsonar", "lv_ez1"),
        beam_width_deg=40.0,
        min_range_m=0.1524,
        max_range_m=6.45,
        range_error=0.04,
        rate_hz=20.0,
        faults=replace(_USUAL, clips=True, resolution_m=0.0254),
        sources={
            **_SHARED,
            "beam_width_deg": "assumed: the data sheet draws beam patterns and names no angle",
            "min_range_m max_range_m": "data sheet: 6 to 254 inches",
            "range_error": f"{_SOUND}; 1 inch by the data sheet",
            "rate_hz": "data sheet: a reading every 50 ms",
        },
        remark="Whatever is nearer than 6 inches reads as 6 inches.",
    ),
)
