"""How far the points of walls move away from them with each number of a hypothesis.

Slopes are those of the expected ranges: the error of a measured one is in the residual as well, and
would pretend that shorter ranges fit better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mapping.diagnosis.hypothesis import Hypothesis, Number, Session
from mapping.readings import Readings
from recorder.columns import Floats, Ints


@dataclass(frozen=True, slots=True)
class Met:
    """K beams that meet walls: ``row`` counts readings, ``axis`` all axes of the session.

    ``normal`` (K, 2) of the wall, away from the sensor; ``way`` (K, 2) along the beam, of a cone
    along the normal, whichever way it looks; ``range_m`` (K,) at which the wall is met.
    """

    row: Ints
    axis: Ints
    normal: Floats
    way: Floats
    range_m: Floats
    is_cone: bool = False


def slopes(
    session: Session, at: Hypothesis, numbers: Sequence[Number], readings: Readings, met: Met
) -> Floats:
    """(K, P), metres along the normal for a unit of each number; ``readings`` are those of ``at``.

    Of the time of the poses by differences, of all else in closed form.
    """
    columns = []
    for number in numbers:
        if number.key == "offset_s":
            columns.append(differences(session, at, number, readings, met))
            continue
        if number.sensor is None:
            columns.append(_of_poses(session, number, readings, met))
            continue
        names = [each.name for each in readings.sensors]
        mine = readings.sensor[met.row] == names.index(number.sensor)
        columns.append(np.where(mine, _of_sensor(session, at, number, readings, met), 0.0))
    return np.column_stack(columns) if columns else np.empty((len(met.row), 0))


def _of_poses(session: Session, number: Number, readings: Readings, met: Met) -> Floats:
    """Headings turn a beam about the robot, or the sensor of a cone; places move either."""
    since_s = (readings.t_ns[met.row] - session.placement.track.t_ns[0]) * 1e-9
    match number.key:
        case "x_mps":
            return np.asarray(since_s * met.normal[:, 0])
        case "y_mps":
            return np.asarray(since_s * met.normal[:, 1])
    base, start = readings.world_from_base[met.row], readings.world_from_sensor[met.row]
    arm = np.column_stack([start.x_m - base.x_m, start.y_m - base.y_m])
    if not met.is_cone:
        arm = arm + met.range_m[:, None] * met.way
    turned = arm[:, 0] * met.normal[:, 1] - arm[:, 1] * met.normal[:, 0]
    return np.asarray(turned * since_s if number.key == "heading_radps" else turned)


def _of_sensor(
    session: Session, at: Hypothesis, number: Number, readings: Readings, met: Met
) -> Floats:
    assert number.sensor is not None
    change, cosine = at.of(number.sensor), (met.way * met.normal).sum(axis=1)
    match number.key:
        case "scale":
            return np.asarray(-met.range_m / change.scale * cosine)
        case "bias_m":
            return np.asarray(-cosine / change.scale)
        case "yaw_rad":
            across = met.way[:, 0] * met.normal[:, 1] - met.way[:, 1] * met.normal[:, 0]
            return np.zeros(len(met.row)) if met.is_cone else met.range_m * across
    mounted_rad = session.mount(number.sensor).heading_rad + change.yaw_rad
    carrier_rad = readings.world_from_sensor.heading_rad[met.row] - mounted_rad
    if number.key == "y_m":
        carrier_rad = carrier_rad + np.pi / 2.0
    return np.asarray(
        np.cos(carrier_rad) * met.normal[:, 0] + np.sin(carrier_rad) * met.normal[:, 1]
    )


def differences(
    session: Session, at: Hypothesis, number: Number, readings: Readings, met: Met
) -> Floats:
    """The slope of one number, (K,), by placing all readings twice.

    Of the time of poses over one pose before and after (at most 0.2 s): by the two that a reading
    lies between, the slope would hold their own noise, and fits would draw readings to the middle
    between two poses, where it averages out. Beside gaps, where one of them is missing, it is 0.
    """
    measured_m = session.readings.ranges_m.copy()
    names = [each.name for each in readings.sensors]
    changes = [at.of(name) for name in names]
    sensor = readings.sensor[met.row]
    scale, bias_m = (
        np.array([getattr(c, k) for c in changes])[sensor] for k in ("scale", "bias_m")
    )
    measured_m[met.axis] = met.range_m * scale + bias_m

    step, known = number.step, np.ones(len(met.row), np.bool_)
    if number.key == "offset_s":
        step = max(step, session.pose_interval_s)
        known = session.has_poses(met.row, at.offset_s - step) & session.has_poses(
            met.row, at.offset_s + step
        )

    def along(more: float) -> Floats:
        placed = session.under(
            at.with_number(number, at.number(number) + more), measured_m=measured_m
        )
        start, way = placed.world_from_sensor, met.normal
        if not met.is_cone:
            heading_rad = start.heading_rad[met.row] + placed.bearings_rad[met.axis]
            way = np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
        at_m = np.column_stack([start.x_m[met.row], start.y_m[met.row]])
        at_m = at_m + placed.ranges_m[met.axis][:, None] * way
        return np.asarray((at_m * met.normal).sum(axis=1))

    return np.where(known, (along(step) - along(-step)) / (2.0 * step), 0.0)
