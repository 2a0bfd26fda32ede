"""The main job on a fresh machine: a simulated robot behind a real serial line → session → map."""

from __future__ import annotations

from pathlib import Path

from recorder.errors import OutputExists


def demo_folder(asked: Path | None, *, force: bool) -> Path:
    """The folder to write into: the asked one, or ``echogrid-demo``, numbered when it is taken."""
    if asked is not None:
        if asked.exists() and any(asked.iterdir()) and not force:
            raise OutputExists(asked)
        asked.mkdir(parents=True, exist_ok=True)
        return asked
    number = 1
    folder = Path("echogrid-demo")
    while folder.exists():
        number += 1
        folder = Path(f"echogrid-demo-{number}")
    folder.mkdir(parents=True)
    return folder


def record_demo(
    session: Path, *, room: str, duration_s: float, seed: int, speed: float, quiet: bool
) -> None:
    """Record the simulated robot over a pseudo-terminal, its poses over TCP."""
    from recorder.cli.record import record_line
    from recorder.simulator.room_files import room_to_geojson
    from recorder.simulator.rooms import load_room
    from recorder.simulator.serial_robot import SerialRobot

    place = load_room(room)
    with SerialRobot(place, seed=seed, speed=speed) as robot:
        record_line(
            str(robot.device), session, tracker=robot.tracker_url, duration_s=duration_s,
            mounts=robot.mount_transforms(), walls=room_to_geojson(place), force=True, quiet=quiet,
        )  # fmt: skip
