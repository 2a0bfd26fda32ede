"""Options of ``simulate``: where sensors sit, and what shall be wrong with the run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

from recorder.cli import options
from recorder.errors import BadInput

if TYPE_CHECKING:
    from recorder.geometry import SE2
    from recorder.simulator.faults import RunFaults

_FOREVER_S = 1e9


def _of_sensor(flag: str, field: str, values: str, text: str) -> Callable[..., Any]:
    return click.option(flag, field, multiple=True, metavar=f"NAME={values}", help=text)


_OPTIONS = (
    click.option(
        "--pose-delay", "pose_delay_s", type=float, default=0.0, metavar="S",
        help="Fault: poses show where the robot was so long before their stamps.",
    ),
    click.option(
        "--pose-noise", metavar="M,DEG",
        help="Fault: more noise of each pose, standard deviations, as 0.01,2.",
    ),
    click.option(
        "--pose-drift", metavar="M,DEG", help="Fault: poses drift by so much a minute, as 0.05,1."
    ),
    click.option(
        "--heading-bias", "heading_bias_deg", type=float, default=0.0, metavar="DEG",
        help="Fault: the tracker's headings are too large by so much.",
    ),
    click.option(
        "--wheel-slip", type=options.Number(0, 1), metavar="SHARE",
        help="Fault: how unevenly the wheels slip; usual: 0.02.",
    ),
    click.option(
        "--cross-talk", type=options.Number(0, 1), default=0.0, metavar="SHARE",
        help="Fault: how often a sonar receives the echoes of another one's ping.",
    ),
    _of_sensor(
        "--mount-error", "mount", "X_M,Y_M,DEG",
        "Fault: a sensor sits elsewhere than the session states, seen from there.",
    ),
    _of_sensor("--range-scale", "scale", "FACTOR", "Fault: ranges are so many times too long."),
    _of_sensor("--range-bias", "bias_m", "M", "Fault: ranges are so much too long."),
    _of_sensor(
        "--range-delay", "delay_s", "S", "Fault: ranges were measured so long before their stamps."
    ),
    _of_sensor("--true-beam", "beam_width_deg", "DEG", "Fault: how wide the beam truly is."),
    _of_sensor("--lost", "lost", "SHARE", "Fault: so many readings more have no echo."),
    _of_sensor("--random", "random", "SHARE", "Fault: so many readings are any range at all."),
    _of_sensor("--stuck", "stuck_s", "FROM_S[,TO_S]", "Fault: it repeats one range meanwhile."),
    _of_sensor("--dead", "dead_s", "FROM_S[,TO_S]", "Fault: it is silent meanwhile."),
    click.option("--swap", "swaps", multiple=True, metavar="A,B",
                 help="Fault: the readings of two sensors come under each other's name."),
)  # fmt: skip


def fault_options(command: Callable[..., int]) -> Callable[..., int]:
    """The options of a run's faults; they reach the command as keywords."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def faults_of(choices: dict[str, Any]) -> RunFaults:
    """The faults that were asked for; BadInput for text that is none."""
    from recorder.geometry import SE2
    from recorder.simulator.faults import WHEEL_SLIP, RunFaults, SensorFaults

    noise_m, noise_deg = _numbers("--pose-noise", choices["pose_noise"] or "0,0", (2,))
    drift_m, drift_deg = _numbers("--pose-drift", choices["pose_drift"] or "0,0", (2,))
    slip = choices["wheel_slip"]
    of_sensors: dict[str, dict[str, Any]] = {}
    for flag, field, lengths in (
        ("--range-scale", "scale", (1,)), ("--range-bias", "bias_m", (1,)),
        ("--range-delay", "delay_s", (1,)), ("--true-beam", "beam_width_deg", (1,)),
        ("--lost", "lost", (1,)), ("--random", "random", (1,)), ("--mount-error", "mount", (3,)),
        ("--stuck", "stuck_s", (1, 2)), ("--dead", "dead_s", (1, 2)),
    ):  # fmt: skip
        for text in choices[field]:
            name, values = _named(flag, text, lengths)
            value: Any = values[0]
            if field == "mount":
                value = SE2(values[0], values[1], _radians(values[2]))
            elif field.endswith("_s") and 2 in lengths:
                value = (values[0], values[1] if len(values) == 2 else _FOREVER_S)
            of_sensors.setdefault(name, {})[field] = value
    for text in choices["swaps"]:
        a, comma, b = (part.strip() for part in text.partition(","))
        if not (a and comma and b) or a == b:
            raise BadInput(f"--swap {text}: write the names of two sensors, as ping,dirrs")
        of_sensors.setdefault(a, {})["reports_as"] = b
        of_sensors.setdefault(b, {})["reports_as"] = a
    return RunFaults(
        pose_delay_s=choices["pose_delay_s"], pose_noise_m=noise_m, pose_noise_deg=noise_deg,
        pose_drift_mpmin=drift_m, pose_drift_degpmin=drift_deg,
        heading_bias_deg=choices["heading_bias_deg"],
        wheel_slip=WHEEL_SLIP if slip is None else slip, cross_talk=choices["cross_talk"],
        sensors={name: SensorFaults(**values) for name, values in of_sensors.items()},
    )  # fmt: skip


def mounts_of(texts: Sequence[str]) -> dict[str, SE2]:
    """Where sensors sit, by their names; BadInput for text that is no mount."""
    from recorder.geometry import SE2

    named = [_named("--mount", text, (3,)) for text in texts]
    return {name: SE2(x_m, y_m, _radians(deg)) for name, (x_m, y_m, deg) in named}


def _named(flag: str, text: str, lengths: Sequence[int]) -> tuple[str, list[float]]:
    name, equals, values = text.partition("=")
    if not (name.strip() and equals):
        raise BadInput(f"{flag} {text}: write it as NAME=VALUE, as in ping=...")
    return name.strip(), _numbers(f"{flag} {name}", values, lengths)


def _numbers(what: str, text: str, lengths: Sequence[int]) -> list[float]:
    """Numbers with commas between; BadInput where there are not so many."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in lengths or not all(abs(value) <= _FOREVER_S for value in values):
        count = " or ".join(map(str, lengths))
        plural = "" if lengths == (1,) else "s"
        raise BadInput(f"{what}: expected {count} number{plural}, not {text!r}")
    return values


def _radians(degrees: float) -> float:
    import math

    return math.radians(degrees)
