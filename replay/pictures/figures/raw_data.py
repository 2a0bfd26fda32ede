"""Mapping with raw data: points of a sonar and of an infrared sensor, and a turned head."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from recorder.geometry import SE2
from replay.pictures import style
from replay.pictures.figures.bench import Bench, Role, box_of_beam
from replay.pictures.figures.figure import Drawing, Figure, LeftOut
from replay.pictures.figures.shading import (
    arc_m,
    blank,
    colour_of,
    cone,
    degrees,
    dots,
    path,
    percent,
    robot,
    walls,
)
from replay.pictures.parts import Box, Dots, Mark, Strokes, Trail, Words

PING, HEAD, DIRRS = "Mapping Raw Ping))) Data", "Changing Head Angle", "Mapping Raw DIRRS+ Data"
_MOST_LINES = 400

RoleOf = Callable[[Bench], Role]


def _sonar(bench: Bench) -> Role:
    return bench.sonar


def _narrow(bench: Bench) -> Role:
    return bench.narrow


def _where(bench: Bench, role: Role) -> Drawing:
    _, base = bench.points(role)
    marks: list[Mark] = [*walls(bench), *path(bench)]
    marks.append(
        Dots(base, colour_of(bench, role), 3.0, f"places of a reading of {role.sensor.name}")
    )
    caption = (
        f"Where the robot was when {role.sensor.name} saw something: {len(base):,} readings from "
        f"{len(np.unique(base, axis=0)):,} places. Poses come from the session."
    )
    return Drawing((blank(bench, "", marks),), caption)


def _offset(bench: Bench, role: Role) -> Drawing:
    beam = bench.typical(role)
    base, sensor = beam.world_from_base, beam.world_from_sensor
    range_m = float(beam.ranges_m[beam.saw_something][0])
    x, y = beam.points_m[0]
    ahead = base.inverse() @ sensor
    legs = np.array([[[base.x_m, base.y_m], [sensor.x_m, sensor.y_m]]])
    ray = np.array([[[sensor.x_m, sensor.y_m], [x, y]]])
    marks: list[Mark] = [
        *walls(bench),
        *robot(base),
        Strokes(legs, style.INK, 2.4, "from the centre to the sensor"),
        Strokes(ray, colour_of(bench, role), 1.4, "the range"),
        Dots(np.array([[x, y]]), colour_of(bench, role), 6.0, "the obstacle, if straight ahead"),
    ]
    side = "ahead of" if ahead.x_m >= 0 else "behind"
    caption = (
        f"The sensor {role.sensor.name} sits {100 * abs(ahead.x_m):.3g} cm {side} the robot's "
        f"centre, at ({base.x_m:.3f}, {base.y_m:.3f}) m, and looks along "
        f"{degrees(sensor.heading_rad)}. It measures {range_m:.3f} m from where it sits, so the "
        f"obstacle lies at ({x:.3f}, {y:.3f}) m."
    )
    return Drawing((blank(bench, "", marks, box_of_beam(beam)),), caption)


def _rays(bench: Bench, role: Role) -> Drawing:
    points, base = bench.points(role)
    if not len(points):
        raise LeftOut(f"{role.sensor.name} saw nothing")
    taken = np.linspace(0, len(points) - 1, min(len(points), _MOST_LINES)).astype(np.int64)
    ends = np.stack([base[taken], points[taken]], axis=1)
    colour = colour_of(bench, role)
    some = "each reading" if len(taken) == len(points) else f"{len(taken)} of the readings"
    marks: list[Mark] = [
        *walls(bench), Strokes(ends, colour, 0.4, f"readings of {role.sensor.name}"),
        *path(bench), dots(bench, role, points[taken]),
    ]  # fmt: skip
    caption = (
        f"For {some} of {role.sensor.name} a line from the robot's centre to the obstacle, as if "
        "this stood straight ahead."
    )
    return Drawing((blank(bench, "", marks),), caption)


def _points(bench: Bench, role: Role) -> Drawing:
    points, _ = bench.points(role)
    if not len(points):
        raise LeftOut(f"{role.sensor.name} saw nothing")
    beside = ~(
        (points >= bench.frame.corners_m[0]) & (points <= bench.frame.corners_m[1])
    ).all(axis=1)  # fmt: skip
    marks = [*walls(bench), dots(bench, role, points)]
    caption = f"{len(points):,} obstacle points of {role.sensor.name} make a rough outline" + (
        f"; {int(beside.sum()):,} lie outside the picture." if beside.any() else "."
    )
    return Drawing((blank(bench, "", marks),), caption)


def _of(draw: Callable[[Bench, Role], Drawing], role: RoleOf) -> Callable[[Bench], Drawing]:
    return lambda bench: draw(bench, role(bench))


def _head(bench: Bench) -> Drawing:
    role = bench.any_ranger
    beam = bench.typical(role)
    if len(beam.ranges_m) > 1:
        raise LeftOut("a laser that scans has no head to turn")
    base, range_m = beam.world_from_base, float(beam.ranges_m[0])
    mount = base.inverse() @ beam.world_from_sensor
    reach = range_m + abs(mount.x_m) + abs(mount.y_m)
    frame = Box(base.x_m, base.y_m, base.x_m, base.y_m).grown_to(3.0 * reach, 3.0 * reach)
    panels = []
    for turn_deg in (90, 0, -90):
        sensor = base @ SE2(0.0, 0.0, math.radians(turn_deg)) @ mount
        x = sensor.x_m + range_m * math.cos(sensor.heading_rad)
        y = sensor.y_m + range_m * math.sin(sensor.heading_rad)
        ray = np.array([[[sensor.x_m, sensor.y_m], [x, y]]])
        marks: list[Mark] = [
            *robot(base), Strokes(ray, colour_of(bench, role), 1.5, "the range"),
            Dots(np.array([[x, y]]), colour_of(bench, role), 6.0, "the obstacle"),
            Words((x, y + 0.22 * reach), f"({x:.2f}, {y:.2f})", style.INK),
        ]  # fmt: skip
        panels.append(blank(bench, f"head at {turn_deg}°", marks, frame))
    caption = (
        f"The same reading of {role.sensor.name}, {range_m:.2f} m, with the head turned to the "
        "left, ahead and to the right: the head's angle is added to the robot's, about its centre, "
        "and the calculation stays the same."
    )
    return Drawing(tuple(panels), caption)


def _cones(bench: Bench) -> Drawing:
    sonar, narrow = bench.both
    panels = []
    for role in (sonar, narrow):
        beam, error = bench.typical(role), role.sensor.range_error
        marks = [*cone(bench, beam, error), *robot(beam.world_from_base)]
        title = f"{role.sensor.name}: {degrees(role.sensor.beam_width_rad)}, ±{percent(error)}"
        panels.append(blank(bench, title, marks, box_of_beam(beam)))
    caption = (
        "The beam of each sensor as a wedge. The obstacle may stand anywhere between the two "
        "dashed arcs: as wide as the beam, as deep as the error of the range. "
        f"{sonar.sensor.name}: {degrees(sonar.sensor.beam_width_rad)} and "
        f"±{percent(sonar.sensor.range_error)}; {narrow.sensor.name}: "
        f"{degrees(narrow.sensor.beam_width_rad)} and ±{percent(narrow.sensor.range_error)}."
    )
    return Drawing(tuple(panels), caption)


def _cone(bench: Bench) -> Drawing:
    role = bench.any_ranger
    beam = bench.typical(role)
    if len(beam.ranges_m) > 1:
        raise LeftOut("a laser's beams are lines, not cones")
    axis = np.array([[[beam.world_from_sensor.x_m, beam.world_from_sensor.y_m], beam.points_m[0]]])
    marks: list[Mark] = [
        *cone(bench, beam), Strokes(axis, style.INK, 0.8, "its axis"),
        Trail(arc_m(beam, float(beam.ranges_m[0])), style.INK, 2.0, "where the obstacle may stand"),
        *robot(beam.world_from_base),
    ]  # fmt: skip
    caption = (
        f"A beam grows wider with distance. It is taken as a wedge of "
        f"{degrees(role.sensor.beam_width_rad)}: the reading of {float(beam.ranges_m[0]):.2f} m "
        "fits an obstacle anywhere along the arc."
    )
    return Drawing((blank(bench, "", marks, box_of_beam(beam)),), caption)


FIGURES = (
    Figure("sonar-places", PING, "Where the sonar measured", _of(_where, _sonar)),
    Figure("sonar-offset", PING, "From a sonar's range to a place", _of(_offset, _sonar)),
    Figure("sonar-rays", PING, "The sonar's readings as lines", _of(_rays, _sonar)),
    Figure("sonar-points", PING, "The sonar's raw points", _of(_points, _sonar)),
    Figure("head-turned", HEAD, "The head turned", _head),
    Figure("infrared-places", DIRRS, "Where the infrared measured", _of(_where, _narrow)),
    Figure("infrared-offset", DIRRS, "From an infrared range to a place", _of(_offset, _narrow)),
    Figure("infrared-rays", DIRRS, "The infrared's readings as lines", _of(_rays, _narrow)),
    Figure("infrared-points", DIRRS, "The infrared's raw points", _of(_points, _narrow)),
    Figure("cone", "Sensor Models", "A beam as a wedge", _cone),
    Figure("cones", "Sensor Models", "The two beams and their errors", _cones),
)
