"""What ``record`` and its kin share: the options of a line, and everything around a recording."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from recorder.cli import options
from recorder.cli.progress import warn

if TYPE_CHECKING:
    from recorder.recording import RecordingStatus
    from recorder.recording.controls import Controls
    from recorder.recording.options import RecordingOptions
    from recorder.translation import RecordingCounters

_LONGEST_S = 1e9  # 30 years

_OPTIONS = (
    click.option(
        "--protocol",
        default="echogrid",
        show_default=True,
        help="The protocol of the robot: echogrid, rbc, csv, or your own PROTOCOL.py.",
    ),
    click.option("--columns", help="For csv, what the columns are, as in t_ms,ping:cm,dirrs:mm,-"),
    click.option(
        "--baud", type=int, help="Speed of the line in bits a second; default: the protocol's."
    ),
    click.option("--tracker", help="Poses as JSON lines: tcp://HOST:PORT or udp://HOST:PORT."),
    click.option(
        "--tracker-px-per-m",
        "px_per_m",
        type=options.Number(min=0, min_open=True),
        help="Pixels a metre, of a tracker that sends pixels; default: it sends metres.",
    ),
    click.option(
        "--wheels",
        metavar="RADIUS_M,TRACK_M,COUNTS[,RANGE]",
        help="Make odometry of wheel counts: radius, distance of the wheels, counts a turn, "
        "and after how many counts the counters begin again (found out when left out).",
    ),
    click.option(
        "--mount",
        "mounts",
        multiple=True,
        metavar="NAME=X_M,Y_M,DEG",
        help="Where a sensor sits on the robot: ahead, to the left, turned counter-clockwise "
        "(NAME@head=...: on its turning head).",
    ),
    click.option(
        "--sensor",
        "sensors",
        multiple=True,
        metavar="NAME=KIND",
        help="What NAME is: a kind (ping, hcsr04, tfmini ...; docs/sensors.md has them all), or "
        "the full width of its beam and its least and greatest range, BEAM_DEG,MIN_M,MAX_M, "
        "with ,ir behind when it is infrared.",
    ),
    click.option(
        "--duration",
        "duration_s",
        type=options.Number(min=0, max=_LONGEST_S),
        help="Seconds to record; default: until q or Ctrl-C.",
    ),
    click.option("--pause", is_flag=True, help="Begin paused: space, p or SIGUSR1 goes on."),
    click.option(
        "--split-mb",
        type=options.Number(min=0.1),
        help="Begin a new file after so many MB; default: never.",
    ),
    click.option(
        "--split-s",
        type=options.Number(min=1),
        help="Begin a new file after so many seconds; default: never.",
    ),
    click.option(
        "--min-free-mb",
        type=options.Number(min=0),
        default=200.0,
        show_default=True,
        help="Stop before the disk has less than so many MB free.",
    ),
    click.option(
        "--seed",
        type=int,
        default=0,
        show_default=True,
        help="With sim:ROOM, of the robot's noise.",
    ),
)


def line_options(command: Callable[..., int]) -> Callable[..., int]:
    """The options of how a line is recorded; they reach the command as keywords."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


@dataclass(frozen=True, slots=True)
class Prepared:
    """A source that is there, what is known of it, and who watches and stops the recording."""

    source: str
    options: RecordingOptions
    controls: Controls
    on_status: Callable[[RecordingStatus], None] | None
    status_period_s: float


@contextmanager
def prepared(
    source: str, output: Path, choices: dict[str, Any], *, force: bool, quiet: bool
) -> Iterator[Prepared]:
    """Everything around a recording of ``source`` into ``output``, with the ``line_options``.

    Raises OutputExists, and BadInput for options that make no sense.
    """
    from recorder.inputs import note_input
    from recorder.outputs import check_output
    from recorder.recording.controls import Controls, keys, signals
    from recorder.recording.run import opened_source, recorded_input

    if choices["protocol"].endswith(".py"):
        note_input(Path(choices["protocol"]))
    check_output(output, recorded_input(source), force=force)
    options = _options_of(choices, force=force)
    controls = Controls()
    if choices["pause"]:
        controls.pause.set()
    with ExitStack() as stack:
        source, options = stack.enter_context(opened_source(source, options, seed=choices["seed"]))
        stack.enter_context(signals(controls))
        typed = False
        if sys.stdin is not None and sys.stdin.isatty():
            typed = stack.enter_context(keys(controls, sys.stdin.fileno()))
        on_status, period_s = None, 1.0
        if not quiet:
            from recorder.recording.screen import open_screen

            on_status, period_s = open_screen(stack, output, keys=typed)
        yield Prepared(source, options, controls, on_status, period_s)


def report_counters(
    counters: RecordingCounters, output: Path, *, quiet: bool, source_damage: Sequence[str] = ()
) -> int:
    """Print what came of a recording, and what its source had lost before; the exit code."""
    from recorder.recording.status import lost_anything, nothing_understood

    if not quiet:
        paused = f", {counters.paused_messages} left out in pauses" if counters.pauses else ""
        click.echo(f"{output}: {counters.written} messages, {counters.poses} poses{paused}")
    if counters.failure:
        warn(counters.failure)
    elif nothing_understood(counters):
        such = f", such as {counters.refused}" if counters.refused else ""
        other = "other --columns, or another" if counters.refused else "another"
        warn(f"nothing of what came was understood{such}: {other} --protocol?")
    elif counters.refused:
        warn(f"{counters.malformed} lines were not taken, such as {counters.refused}")
    for reason in source_damage:
        warn(reason)
    return 1 if source_damage or lost_anything(counters) else 0


def _options_of(choices: dict[str, Any], *, force: bool) -> RecordingOptions:
    from recorder.recording.options import (
        RecordingOptions,
        parse_mount,
        parse_sensor,
        parse_wheels,
    )
    from recorder.session import Limits

    as_they_are = ("protocol", "columns", "baud", "tracker", "px_per_m", "duration_s")
    return RecordingOptions(
        **{name: choices[name] for name in as_they_are},
        force=force,
        wheels=None if choices["wheels"] is None else parse_wheels(choices["wheels"]),
        mounts=tuple(parse_mount(mount) for mount in choices["mounts"]),
        sensors=dict(parse_sensor(sensor) for sensor in choices["sensors"]),
        limits=Limits(choices["split_mb"], choices["split_s"], choices["min_free_mb"]),
    )
