"""``import``: other people's logs into a session."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from recorder.cli import options


@click.command("import", epilog="Example:  echogrid import trace21.trc -o t.mcap")
@click.argument("files", nargs=-1, required=True, type=options.INPUT)
@options.output_session
@click.option(
    "--format", "form", help="comp4807, carmen, sonar-ring or csv; guessed when left out."
)
@click.option(
    "--rate",
    type=float,
    default=20.0,
    show_default=True,
    help="Rows a second of a log that has no clock.",
)
@click.option(
    "--start",
    type=float,
    default=0.0,
    show_default=True,
    help="When it began, in UNIX seconds, of a log that does not say.",
)
@click.option(
    "--columns",
    multiple=True,
    help="csv: what the columns are, as in t_ms,head:deg,ping:cm (guessed when left out); "
    "comp4807: the sensors in their order, as in ping,dirrs; default: the header's; once more as "
    "200:dirrs,ping for another order from row 200 on.",
)
@click.option("--pose", metavar="X,Y,DEG", help="csv: where a robot that stands still is.")
@click.option(
    "--wheels",
    metavar="RADIUS_M,TRACK_M,COUNTS[,RANGE]",
    help="csv: make odometry of wheel counts: radius, distance of the wheels, counts a turn, "
    "and after how many counts the counters begin again (found out when left out).",
)
@click.option(
    "--mount",
    "mounts",
    multiple=True,
    metavar="NAME=X_M,Y_M,DEG",
    help="csv: where a sensor sits on the robot (NAME@head=...: on its turning head).",
)
@click.option(
    "--sensor",
    "sensors",
    multiple=True,
    metavar="NAME=KIND",
    help="csv: what NAME is, as in record.",
)
@options.force
@options.quiet
def import_(
    files: tuple[Path, ...], output: Path, form: str | None, force: bool, quiet: bool,
    **choices: Any,
) -> int:  # fmt: skip
    """Turn other people's logs into a session."""
    from recorder.importers import guess_format, import_log
    from recorder.outputs import check_output
    from recorder.session import SessionWriter

    check_output(output, files, force=force)
    name = form or guess_format(files[0])
    found = import_log(name, files, _options_of(name, choices))
    metadata = {**found.metadata, "dropped": dict(found.dropped), "file": files[0].name}
    with SessionWriter(output, metadata=metadata, force=force) as session:
        for log_ns, message in found.records:
            session.write(message, log_ns=log_ns)
    if not quiet:
        dropped = ", ".join(f"{why} {n}" for why, n in found.dropped.items()) or "nothing"
        guessed = "" if form else f"{files[0].name} is {name}; "
        click.echo(f"{guessed}{output}: {len(found.records)} messages; dropped: {dropped}")
        for key in ("columns", "clock", "pose_note", "first_bad_row", "beam_note"):
            if key in found.metadata and name != "comp4807":
                note = f" ({found.metadata['columns_note']})" if key == "columns" else ""
                click.echo(
                    f"  {key.removesuffix('_note').replace('_', ' ')}: {found.metadata[key]}{note}"
                )
    return 0


def _options_of(name: str, choices: dict[str, Any]) -> dict[str, Any]:
    """The reader's keywords: rate and start where it takes them, the rest only where given."""
    from recorder.errors import BadInput
    from recorder.importers import IMPORTERS
    from recorder.recording.options import parse_mount, parse_pose, parse_sensor, parse_wheels

    if name not in IMPORTERS:
        raise BadInput(f"unknown format {name!r} (known: {', '.join(IMPORTERS)})")
    takes = IMPORTERS[name].options
    clock = {"rate_hz": choices["rate"], "start_s": choices["start"]}
    out: dict[str, Any] = {key: value for key, value in clock.items() if key in takes}
    out |= _columns_of(name, choices["columns"])
    if choices["pose"] is not None:
        out["pose"] = parse_pose(choices["pose"])
    if choices["wheels"] is not None:
        out["wheels"] = parse_wheels(choices["wheels"])
    if choices["mounts"]:
        out["mounts"] = tuple(parse_mount(mount) for mount in choices["mounts"])
    if choices["sensors"]:
        out["sensors"] = dict(parse_sensor(sensor) for sensor in choices["sensors"])
    return out


def _columns_of(name: str, given: tuple[str, ...]) -> dict[str, Any]:
    """The orders of columns: of the whole file, and from a row on (``200:dirrs,ping``)."""
    from recorder.errors import BadInput

    out: dict[str, Any] = {}
    for text in given:
        row, colon, names = text.partition(":")
        if name == "comp4807" and colon and row.strip().isdecimal() and len(row) < 10:
            order = tuple(part.strip() for part in names.split(","))
            out.setdefault("changes", {})[int(row)] = order
        elif "columns" in out:
            raise BadInput(f"--columns {text}: columns are named already")
        else:
            parts = tuple(part.strip() for part in text.split(","))
            out["columns"] = text if name == "csv" else parts
    return out
