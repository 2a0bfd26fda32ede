"""Draw the picture of docs/diff.md again: ``python docs/make_diff_picture.py``.

Two drives through the room ``room`` with different seeds; in the second the left box stands 15 cm
further to the right.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from mapping.config import load_config
from recorder.session import SessionWriter
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import Room, load_room
from replay.diff.comparing import compare
from replay.diff.picture import save_picture

PICTURE = Path(__file__).resolve().parent / "images" / "diff.png"
DURATION_S = 60.0
BOX = slice(4, 8)  # the walls of the left box


def main() -> None:
    """The picture into docs/images, and the verdict on the terminal."""
    room = load_room("room")
    walls_m = np.array(room.walls_m)
    walls_m[BOX, :, 0] += 0.15
    pushed = Room("box pushed aside", walls_m, np.array(room.route_m))
    config = load_config(settings=["grid.resolution_m=0.02"])
    with tempfile.TemporaryDirectory() as folder:
        paths = [
            _session(Path(folder, name), one, seed)
            for name, one, seed in (("before.mcap", room, 1), ("after.mcap", pushed, 5))
        ]
        report = compare(*paths, config, only=["dirrs"])
        save_picture(report, PICTURE)
    print(f"{PICTURE.name}: {report.verdict.text}")


def _session(path: Path, room: Room, seed: int) -> Path:
    with SessionWriter(path) as writer:
        for log_ns, message in simulate(room, duration_s=DURATION_S, seed=seed):
            writer.write(message, log_ns=log_ns)
    return path


if __name__ == "__main__":
    main()
