"""``ports``: the serial devices, which one talks, and in what."""

from __future__ import annotations

import click

from recorder.cli import options


@click.command(epilog="Example:  echogrid ports")
@click.option("--also", multiple=True, metavar="DEVICE", help="A device that is not listed.")
@click.option("--only", is_flag=True, help="Nothing but the devices named by --also.")
@click.option(
    "--baud",
    "bauds",
    multiple=True,
    type=click.IntRange(min=1),
    help="Speeds to listen at; default: 115200 and 9600.",
)
@click.option(
    "--seconds",
    type=options.Number(min=0.1),
    default=2.5,
    show_default=True,
    help="How long to listen at each speed.",
)
@click.option(
    "--probe-write",
    is_flag=True,
    help="Also greet what is silent, as the course's robot wants it (byte 10).",
)
@options.quiet
def ports(
    also: tuple[str, ...], only: bool, bauds: tuple[int, ...], seconds: float,
    probe_write: bool, quiet: bool,
) -> int:  # fmt: skip
    """List the serial devices, which one talks, and in what.

    All are listened to at once, and nothing is written to them. Opening a port restarts most
    Arduinos. With --quiet only those that talk are listed.
    """
    from recorder.link import serial_devices
    from recorder.port_probe import BAUDS, probe_ports

    known = {} if only else serial_devices()
    devices = list(dict.fromkeys((*known, *also)))
    reports = probe_ports(devices, bauds=bauds or BAUDS, listen_s=seconds, write=probe_write)
    width = max(map(len, devices), default=0)
    for report in reports:
        if quiet and not report.protocol:
            continue
        more = (report.detail if report.protocol else "", known.get(report.device, ""))
        details = "".join(f"  ({each})" for each in more if each)
        click.echo(f"{report.device:{width}}  {report.verdict}{details}")
    if not devices and not quiet:
        click.echo("no serial device: is one plugged in?")
    return 0
