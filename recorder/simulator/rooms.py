"""Simulated rooms: walls that are known exactly, and a closed route that a robot can drive.

The built-in ones suit a small robot (some 10 cm wide) with a sonar that reaches 4 m and an
infrared ranger that sees up to 0.8 m. Others come from GeoJSON files, in metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from recorder.errors import BadInput
from recorder.names import did_you_mean
from recorder.simulator.routes import (
    ROBOT_RADIUS_M,
    default_route,
    inside,
    random_route,
    route_along_walls,
    route_far_from_walls,
    route_on_the_spot,
)
from recorder.simulator.surfaces import wall_surfaces
from recorder.simulator.walls import disc, join, leg_clearance, path, rectangle
from recorder.truth import read_surfaced_walls


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """Walls and a way through them, in metres in the map frame; both arrays are read-only.

    ``walls_m`` (K, 2, 2) are straight pieces, ``route_m`` (N, 2) the waypoints of a route that
    returns from the last to the first. ``surfaces`` (K) names what each wall is made of; smooth
    where it is empty.
    """

    name: str
    walls_m: NDArray[np.float64]
    route_m: NDArray[np.float64]
    surfaces: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.walls_m.shape[1:] != (2, 2) or self.route_m.shape[1:] != (2,):
            raise ValueError("walls are (K, 2, 2) and a route is (N, 2)")
        for values in (self.walls_m, self.route_m):
            if len(values) == 0 or not np.isfinite(values).all():
                raise ValueError("a room needs walls and a route, all of finite numbers")
            values.setflags(write=False)
        if self.surfaces and len(self.surfaces) != len(self.walls_m):
            raise ValueError("a room has as many surfaces as walls, or none")


def load_room(name_or_path: str | Path) -> Room:
    """A built-in room by name, or the room of a GeoJSON file with a route of its own making.

    Raises BadInput for a name that is neither, and for a file that holds no usable walls.
    """
    name = str(name_or_path)
    if name in ROOMS:
        return ROOMS[name]
    file = Path(name)
    if file.suffix.lower() not in (".json", ".geojson") and not file.exists():
        raise BadInput(f"no room {name!r} and no such file; {did_you_mean(name, ROOMS)}")
    walls_m, surfaces = read_surfaced_walls(file)
    try:
        wall_surfaces(surfaces)  # all of them are known
        return Room(file.stem, walls_m, default_route(walls_m), surfaces)
    except BadInput as error:
        raise BadInput(f"{file}: {error}") from None


def named_walls(given: str) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """The walls (K, 2, 2) of a built-in room by name or of a GeoJSON file, and their surfaces.

    Raises BadInput, in one line, for what is neither.
    """
    if given in ROOMS:
        return ROOMS[given].walls_m, ROOMS[given].surfaces
    file = Path(given)
    if not file.exists() and file.suffix.lower() not in (".json", ".geojson"):
        raise BadInput(f"no room {given!r} and no such file; {did_you_mean(given, ROOMS)}")
    return read_surfaced_walls(file)


def parse_route(text: str, room: Room, seed: int = 0) -> NDArray[np.float64]:
    """``"x,y;x,y;..."`` in metres → waypoints (N, 2), or a route by its name.

    ``default`` is the room's own route, ``spin`` a turn on the spot in its middle, ``walls`` along
    its outer walls, ``far`` far from all, ``random`` past places that follow from the seed.

    The route is closed: it returns from the last waypoint to the first. A single waypoint makes
    the robot turn on the spot there. Raises BadInput for text that is no route, and for a route
    that crosses a wall, comes too close to one for the robot's body, or lies outside the room.
    """
    if text.strip() == "default":
        return room.route_m
    if text.strip() in ROUTES:
        route_m = ROUTES[text.strip()](room.walls_m, seed)
        check_route(route_m, room)
        return route_m
    waypoints = [_waypoint(part) for part in text.split(";") if part.strip()]
    if not waypoints:
        raise BadInput("the route is empty; write it as x,y;x,y;... in metres")
    route_m = np.array(waypoints, dtype=np.float64)
    check_route(route_m, room)
    route_m.setflags(write=False)
    return route_m


_Route = Callable[[NDArray[np.float64], int], NDArray[np.float64]]
ROUTES: Mapping[str, _Route] = MappingProxyType({
    "spin": lambda walls_m, seed: route_on_the_spot(walls_m),
    "walls": lambda walls_m, seed: route_along_walls(walls_m),
    "far": lambda walls_m, seed: route_far_from_walls(walls_m),
    "random": random_route,
})  # fmt: skip


def check_route(route_m: NDArray[np.float64], room: Room) -> None:
    """Raises BadInput, in one line, unless a robot can drive the closed route (N, 2)."""
    outside = np.flatnonzero(~inside(route_m, room.walls_m))
    if outside.size:
        raise BadInput(f"the route leaves room {room.name!r} at {_at(route_m[outside[0]])}")
    for start, end in zip(route_m, np.roll(route_m, -1, axis=0), strict=True):
        clearance_m = leg_clearance(start, end, room.walls_m)
        leg = f"the route from {_at(start)} to {_at(end)}"
        if clearance_m == 0.0:
            raise BadInput(f"{leg} crosses a wall of room {room.name!r}")
        if clearance_m < ROBOT_RADIUS_M:
            raise BadInput(
                f"{leg} comes within {clearance_m:.3f} m of a wall of room {room.name!r};"
                f" the robot needs {ROBOT_RADIUS_M} m"
            )


def _waypoint(text: str) -> tuple[float, float]:
    try:
        x_m, y_m = (float(number) for number in text.split(","))
    except ValueError:
        raise BadInput(f"{text.strip()!r} is no waypoint; write it as x,y in metres") from None
    if not (math.isfinite(x_m) and math.isfinite(y_m)):
        raise BadInput(f"{text.strip()!r} is no waypoint: its numbers are not finite")
    return x_m, y_m


def _at(point_m: NDArray[np.float64]) -> str:
    return f"({point_m[0]:g}, {point_m[1]:g})"


def _room(
    name: str,
    walls: tuple[NDArray[np.float64], ...],
    route: list[tuple[float, float]],
    surfaces: tuple[str, ...] = (),
) -> Room:
    """``surfaces`` are those of the groups of walls, where not all are smooth."""
    of_each = [s for s, group in zip(surfaces, walls, strict=bool(surfaces)) for _ in group]
    return Room(name, join(*walls), np.array(route, dtype=np.float64), tuple(of_each))


def _skewed() -> Room:
    """A rectangle that no wall of the map's grid is parallel to."""
    angle_rad = math.radians(20.0)
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    route = [(0.3, 0.3), (1.1, 1.1), (1.9, 0.3), (1.9, 1.2), (1.1, 0.4), (0.3, 1.2)]
    centre = (c * 1.1 - s * 0.75, s * 1.1 + c * 0.75)
    return _room(
        "skewed",
        (rectangle(centre, 2.2, 1.5, angle_rad),),
        [(c * x - s * y, s * x + c * y) for x, y in route],
    )


_BUILT_IN = (
    _room(
        "room",
        (
            rectangle((1.1, 0.8), 2.2, 1.6),
            rectangle((0.75, 0.80), 0.30, 0.25),
            rectangle((1.55, 0.85), 0.25, 0.30),
        ),
        [(0.30, 0.30), (1.15, 0.42), (1.90, 0.30), (1.92, 0.85), (1.90, 1.32),
         (1.15, 1.22), (1.13, 0.45), (1.17, 1.20), (0.30, 1.32), (0.28, 0.80)],
    ),
    _room(
        "empty",
        (rectangle((1.0, 0.75), 2.0, 1.5),),
        [(0.3, 0.3), (1.0, 1.1), (1.7, 0.3), (1.7, 1.2), (1.0, 0.4), (0.3, 1.2)],
    ),
    _room(
        "l-room",
        (path([(0.0, 0.0), (2.4, 0.0), (2.4, 1.0), (1.1, 1.0), (1.1, 2.0), (0.0, 2.0)],
              closed=True),),
        [(0.3, 0.3), (1.3, 0.7), (2.1, 0.3), (2.1, 0.7), (1.3, 0.3), (0.8, 0.8),
         (0.3, 1.1), (0.8, 1.7), (0.3, 1.7), (0.8, 1.1)],
    ),
    _room(
        "corridor",
        (
            rectangle((1.7, 0.8), 3.4, 1.6),
            path([(0.0, 0.7), (0.6, 0.7)]),
            path([(1.0, 0.7), (2.4, 0.7)]),
            path([(2.8, 0.7), (3.4, 0.7)]),
            path([(1.7, 0.7), (1.7, 1.6)]),
        ),
        [(0.3, 0.35), (0.8, 0.5), (0.8, 1.0), (0.35, 1.25), (1.35, 1.25), (0.8, 1.0),
         (0.8, 0.5), (1.7, 0.25), (2.6, 0.5), (2.6, 1.0), (2.05, 1.25), (3.05, 1.25),
         (2.6, 1.0), (2.6, 0.5), (3.1, 0.35), (1.7, 0.45)],
    ),
    _room(
        "cluttered",
        (
            rectangle((1.4, 1.1), 2.8, 2.2),
            path([(1.4, 2.2), (1.4, 1.5)]),
            rectangle((0.175, 1.1), 0.35, 0.5),
            rectangle((0.85, 1.55), 0.3, 0.3, math.radians(30.0)),
            rectangle((0.95, 0.7), 0.4, 0.25, math.radians(-15.0)),
            rectangle((2.0, 0.65), 0.25, 0.5, math.radians(10.0)),
            rectangle((2.575, 2.0), 0.45, 0.4),
            disc((2.0, 1.5), 0.12),
        ),
        [(0.35, 0.35), (1.4, 0.25), (2.45, 0.25), (2.45, 1.1), (2.4, 1.5), (2.05, 1.85),
         (1.65, 1.85), (1.7, 1.15), (1.35, 1.1), (1.2, 1.85), (0.4, 1.85), (0.55, 1.1)],
    ),
    _room(
        "pillar",
        (rectangle((1.0, 0.8), 2.0, 1.6), disc((1.0, 0.8), 0.2)),
        [(0.3, 0.3), (1.0, 0.4), (1.7, 0.3), (1.6, 0.8), (1.7, 1.3), (1.0, 1.2),
         (0.3, 1.3), (0.4, 0.8)],
    ),
    _skewed(),
    _room(
        "square",
        (rectangle((1.0, 1.0), 2.0, 2.0),),
        [(0.3, 0.3), (1.0, 1.0), (1.7, 0.3), (1.7, 1.7), (1.0, 1.0), (0.3, 1.7)],
    ),
    _room(
        "glass",
        (
            rectangle((1.2, 0.8), 2.4, 1.6),
            path([(1.2, 0.0), (1.2, 0.9)]),
            rectangle((2.05, 1.3), 0.3, 0.2),
        ),
        [(0.3, 0.3), (0.9, 0.3), (0.9, 1.2), (1.5, 1.2), (1.5, 0.3), (2.1, 0.3), (2.1, 0.9),
         (1.5, 1.2), (0.6, 1.3), (0.3, 0.9)],
        ("smooth", "glass", "glass"),
    ),
    _room(
        "rough",
        (
            rectangle((1.1, 0.8), 2.2, 1.6),
            rectangle((0.75, 0.80), 0.30, 0.25),
            rectangle((1.55, 0.85), 0.25, 0.30, math.radians(25.0)),
        ),
        [(0.30, 0.30), (1.15, 0.42), (1.90, 0.30), (1.92, 0.85), (1.90, 1.32),
         (1.15, 1.22), (1.13, 0.45), (1.17, 1.20), (0.30, 1.32), (0.28, 0.80)],
        ("rough", "rough", "rough"),
    ),
    _room(
        "flat",
        (
            rectangle((1.8, 1.3), 3.6, 2.6),
            path([(1.6, 0.0), (1.6, 0.6)]), path([(1.6, 1.05), (1.6, 2.6)]),
            path([(1.6, 1.4), (2.1, 1.4)]), path([(2.55, 1.4), (3.6, 1.4)]),
            rectangle((0.3, 2.2), 0.6, 0.8), rectangle((0.75, 0.9), 0.35, 0.25, math.radians(20.0)),
            rectangle((3.35, 0.45), 0.5, 0.5), disc((2.5, 0.7), 0.12),
            rectangle((2.85, 2.4), 0.8, 0.4), rectangle((1.75, 1.75), 0.3, 0.5),
        ),
        [(0.3, 0.3), (1.2, 0.3), (1.25, 0.85), (1.95, 0.82), (2.1, 0.3), (2.8, 0.3), (2.85, 1.0),
         (2.35, 1.05), (2.32, 1.75), (3.3, 1.75), (2.2, 2.2), (2.32, 1.7), (2.3, 1.05),
         (1.95, 0.82), (1.25, 0.85), (1.25, 2.3), (0.85, 2.2), (0.9, 1.35), (0.3, 1.2)],
        ("smooth", "smooth", "smooth", "smooth", "smooth", "rough", "smooth", "smooth", "smooth",
         "rough", "rough"),
    ),
)  # fmt: skip

ROOMS: Mapping[str, Room] = MappingProxyType({room.name: room for room in _BUILT_IN})
