"""How the parts of a recording know each other: by their names, and by what each repeats."""

from __future__ import annotations

import re
from pathlib import Path

from recorder.messages import Message, Odometry, Pose, Transform

PART = "part"  # the key of the metadata with the number of the part


def parts_beside(path: Path, number: int = 1) -> list[Path]:
    """The files that are named as other parts of the recording whose part ``number`` is ``path``.

    In order. Only the names are looked at.
    """
    first = path.stem if number == 1 else re.sub(r"(?<=.)-[0-9]+$", "", path.stem)
    name = re.compile(rf"{re.escape(first)}(?:-([2-9]|[1-9][0-9]+))?{re.escape(path.suffix)}")
    found = [(name.fullmatch(each.name), each) for each in path.parent.glob("*" + path.suffix)]
    numbered = [(int(match[1] or 1), each) for match, each in found if match is not None]
    return [each for _, each in sorted(numbered) if each.name != path.name]


def repeated_as(message: Message) -> tuple[str, ...] | None:
    """What of the past a part must know by itself; a newer message of the same key replaces it."""
    match message:
        case Transform():
            return ("transform", message.parent, message.child)
        case Pose():
            return ("pose",)
        case Odometry():
            return ("odometry",)
        case _:
            return None
