"""docs/sensors.md from the catalogue: ``python docs/make_sensor_page.py``."""

from __future__ import annotations

import math
from pathlib import Path

from recorder.sensors import CATALOGUE, SensorKind

PAGE = Path(__file__).resolve().parent / "sensors.md"

INTRO = """\
# Sensors

What echogrid knows of a kind of sensor is one entry of its catalogue, `recorder/sensors/`. This
page is made of it: `python docs/make_sensor_page.py`.

A sensor is of the kind that its name holds, whatever stands around it: `tfmini`, `tfmini_left`,
`front_tfmini`, `HC-SR04` and `hcsr04_2` all do. For any other name `record` takes `--sensor
left=tfmini`, and `map` takes `--set sensors.left.kind=tfmini`; else its radiation decides: `ping`,
`dirrs` or `lidar`. What the configuration or the session itself states (beam, limits, mount) goes
before the catalogue.

`echogrid simulate room -o run.mcap --sensors hcsr04,tfmini` drives a robot with any of them.

"""
NEW = """\
## A new sensor

Write an entry (`SensorKind`) into the file of its family in `recorder/sensors/`, with a source for
each number, and make this page again. It can then be recorded, simulated, mapped and judged by
`info`; nothing else has to change.
"""


def page() -> str:
    """The whole page."""
    sections = "".join(_section(kind) for kind in CATALOGUE.values())
    return INTRO + _table() + "\n" + sections + NEW


def _table() -> str:
    rows = [
        "| kind | sensor | measures by | beam | range | error | a second | update rule |",
        "|---|---|---|---|---|---|---|---|",
    ]
    rows += [
        f"| `{kind.name}` | {kind.title} | {kind.medium} | {kind.beam_width_deg:g}° "
        f"| {kind.min_range_m:g} to {kind.max_range_m:g} m | {100 * kind.range_error:g} % "
        f"| {kind.rate_hz:g} | `{kind.update}` |"
        for kind in CATALOGUE.values()
    ]
    return "\n".join(rows) + "\n"


def _section(kind: SensorKind) -> str:
    lines = [f"## `{kind.name}`: {kind.title}", ""]
    if kind.remark:
        lines += [kind.remark, ""]
    lines += ["| what | value | source |", "|---|---|---|"]
    for fields, source in kind.sources.items():
        names = fields.split()
        values = "; ".join(_value(kind, name) for name in names)
        lines.append(f"| {', '.join(f'`{name}`' for name in names)} | {values} | {source} |")
    if kind.aliases:
        lines += ["", f"Also found as {', '.join(f'`{alias}`' for alias in kind.aliases)}."]
    return "\n".join(lines) + "\n\n"


def _value(kind: SensorKind, name: str) -> str:
    """One field for people; figures that are 0 are left out of the groups."""
    value = getattr(kind, name)
    match name:
        case "mount":
            return (
                f"x {value.x_m:g} m, y {value.y_m:g} m, {math.degrees(value.heading_rad):g} degrees"
            )
        case "model_parameters":
            return f"{kind.model}: " + ", ".join(f"{key} {v:g}" for key, v in value.items())
        case "faults":
            figures = {key: getattr(value, key) for key in value.__slots__}
            return ", ".join(f"{key} {float(v):g}" for key, v in figures.items() if v)
        case "update":
            return str(value)
        case "scan":
            return (
                f"{value.beams} beams from {value.first_deg:g} degrees, "
                f"{value.increment_deg:g} apart"
            )
        case "invalid_m":
            return ", ".join(f"{each:g}" for each in value)
        case _:
            return f"{value:g}"


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
