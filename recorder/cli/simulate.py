"""``simulate``: the simulated robot without the wait."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from recorder.cli import options
from recorder.cli.simulated_faults import fault_options, faults_of, mounts_of


@click.command(epilog="Example:  echogrid simulate room -o run.mcap --duration 60 --seed 1")
@click.argument("room")
@options.output_session
@click.option(
    "--duration",
    type=options.Number(min=0.1, max=1e6),
    default=60.0,
    show_default=True,
    help="Seconds that the robot drives.",
)
@click.option(
    "--seed",
    type=int,
    default=0,
    show_default=True,
    help="Of the noise: the same number gives the same session.",
)
@click.option(
    "--noise",
    type=options.Number(0, 10),
    default=1.0,
    show_default=True,
    help="How noisy: 0 not at all, 1 as real sensors are.",
)
@click.option(
    "--sensors",
    default="ping,dirrs",
    show_default=True,
    help="Kinds, or names that hold them (tfmini_left), with commas between: docs/sensors.md.",
)
@click.option(
    "--route",
    default="default",
    help='Where it drives: spin, walls (along them), far (from them), random, or "x,y;x,y;..." in '
    "metres; default: the room's own route.",
)
@click.option(
    "--head-sweep",
    type=float,
    default=0.0,
    show_default=True,
    help="Turn the sensors' head to and fro, by so many degrees (0 to 180) to each side.",
)
@click.option(
    "--mount",
    "mounts",
    multiple=True,
    metavar="NAME=X_M,Y_M,DEG",
    help="Where a sensor sits: ahead, to the left, turned counter-clockwise.",
)
@fault_options
@options.force
@options.quiet
def simulate(
    room: str, output: Path, duration: float, seed: int, noise: float, sensors: str, route: str,
    head_sweep: float, mounts: tuple[str, ...], force: bool, quiet: bool, **faults: Any,
) -> int:  # fmt: skip
    """Make a session of a simulated robot, at once.

    ROOM is a room's name (docs/simulator.md shows them) or a GeoJSON file.

    A fault is planted for whoever wants to find it: the session does not state it, but for its
    metadata.
    """
    from recorder.session import SessionWriter
    from recorder.simulator.robot import simulate as run
    from recorder.simulator.rooms import load_room, parse_route
    from recorder.truth import WALLS, WALLS_TYPE, walls_to_geojson

    place = load_room(room)
    path = None if route == "default" else parse_route(route, place, seed)
    wrong = faults_of(faults)
    names = tuple(name.strip() for name in sensors.split(",") if name.strip())
    messages = run(
        place, duration_s=duration, seed=seed, noise=noise, sensors=names, route=path,
        head_sweep_deg=head_sweep, faults=wrong,
        mounts=mounts_of(mounts),
    )  # fmt: skip
    metadata = {"simulated": place.name, "seed": seed, "noise": noise, "duration_s": duration}
    if wrong.stated():
        metadata["faults"] = wrong.stated()
    count = 0
    with SessionWriter(output, metadata=metadata, force=force) as session:
        session.attach(
            WALLS, WALLS_TYPE, walls_to_geojson(place.walls_m, place.name, place.surfaces)
        )
        for log_ns, message in messages:
            session.write(message, log_ns=log_ns)
            count += 1
    if not quiet:
        click.echo(f"{output}: {count} messages")
    return 0
