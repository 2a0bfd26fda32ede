"""``simulate``: the simulated robot without the wait."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.cli import options


@click.command(epilog="Example:  echogrid simulate room -o run.mcap --duration 60 --seed 1")
@click.argument("room")
@options.output_session
@click.option("--duration", type=options.Number(min=0.1), default=60.0, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--noise", type=options.Number(0, 10), default=1.0, show_default=True)
@click.option("--sensors", default="ping,dirrs", show_default=True, help="Also: lidar.")
@click.option("--route", default="default", help='"x,y;x,y;..." in metres.')
@click.option("--head-sweep", type=float, default=0.0, help="Degrees that the head turns.")
@options.force
@options.quiet
def simulate(
    room: str, output: Path, duration: float, seed: int, noise: float, sensors: str, route: str,
    head_sweep: float, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Drive the simulated robot through ROOM (a name or a GeoJSON file) without the wait."""
    from recorder.session import WALLS, SessionWriter
    from recorder.simulator.robot import simulate as run
    from recorder.simulator.room_files import room_to_geojson
    from recorder.simulator.rooms import load_room, parse_route

    place = load_room(room)
    path = None if route == "default" else parse_route(route, place)
    names = tuple(name.strip() for name in sensors.split(",") if name.strip())
    messages = run(
        place, duration_s=duration, seed=seed, noise=noise, sensors=names, route=path,
        head_sweep_deg=head_sweep,
    )  # fmt: skip
    metadata = {"simulated": place.name, "seed": seed, "noise": noise, "duration_s": duration}
    count = 0
    with SessionWriter(output, metadata=metadata, force=force) as session:
        session.attach(WALLS, "application/geo+json", room_to_geojson(place))
        for log_ns, message in messages:
            session.write(message, log_ns=log_ns)
            count += 1
    if not quiet:
        click.echo(f"{output}: {count} messages")
    return 0
