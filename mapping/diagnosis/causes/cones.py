"""What the walls of thin beams tell of a sonar: its cone, its yaw, its ranges."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.interface import Cause, Plot, Settings, Suspect
from mapping.diagnosis.facing import Acceptance, Facing, acceptance, facing, walls_of
from mapping.diagnosis.hypothesis import Hypothesis
from recorder.messages import Radiation

_WIDER, _NARROWER = 1.6, 0.83  # times what is configured
_YAW_RAD = math.radians(4.5)
_BIAS_M = 0.012
_SURE = 5.0


class Cones(Cause):
    """Each wide beam against the walls that the thin ones have drawn, mended already."""

    name, title = "cones", "a sonar's cone, yaw or ranges are not what they should be"

    def examine(self, case: Case, hypothesis: Hypothesis) -> Iterator[Suspect]:
        """One sonar after the other."""
        if not case.thin or case.rough:
            return
        walls = walls_of(case, hypothesis)
        for sensor in case.wide:
            if case.placed.sensors[sensor].radiation is not Radiation.ULTRASOUND:
                continue  # light that is averaged over a cone
            edges = acceptance(case, hypothesis, sensor, walls)
            if edges is not None:
                yield from _of_edges(case, sensor, edges)
            found = facing(case, hypothesis, sensor, walls)
            if found is not None:
                yield from _of_ranges(case, sensor, found)


def _of_edges(case: Case, sensor: str, edges: Acceptance) -> Iterator[Suspect]:
    known = next(each for each in case.readings.sensors if each.name == sensor)
    times = 2.0 * edges.half_width_rad / known.beam_width_rad
    plot = Plot(
        f"how often {sensor} measures a wall", "the wall lies to the left of its axis (degrees)",
        "share of the pings",
        line=np.column_stack([np.degrees(edges.angle_rad), edges.share])[np.isfinite(edges.share)],
        mark=math.degrees(edges.yaw_rad),
    )  # fmt: skip
    if times > _WIDER or times < _NARROWER:
        width_deg = math.degrees(2.0 * edges.half_width_rad)
        yield Suspect(
            "beam", sensor,
            f"the beam of {sensor} is {width_deg:.0f} degrees wide, not "
            f"{math.degrees(known.beam_width_rad):.0f}",
            (f"it measures walls up to {math.degrees(edges.left_rad):.0f} degrees to the left and "
             f"{-math.degrees(edges.right_rad):.0f} to the right of its axis",),
            0.1 * abs(math.log(max(times, 0.1))), "likely",
            settings=_sensor(sensor, beam_width_deg=round(max(width_deg, 2.0), 1)),
            value=times, unit="times", plots=(plot,),
        )  # fmt: skip
    if abs(edges.yaw_rad) > _YAW_RAD:
        mount = case.session.mount(sensor)
        yaw_deg = math.degrees(edges.yaw_rad)
        yield Suspect(
            "mount", sensor,
            f"{sensor} sits turned by {abs(yaw_deg):.0f} +- 3 degrees to the "
            f"{'left' if yaw_deg > 0 else 'right'}",
            (f"it measures walls up to {math.degrees(edges.left_rad):.0f} degrees to the left of "
             f"its axis and {-math.degrees(edges.right_rad):.0f} to the right",),
            0.005 * abs(yaw_deg), "likely",
            settings=_sensor(sensor, mount=[
                round(mount.x_m, 4), round(mount.y_m, 4),
                round(math.degrees(mount.heading_rad) + yaw_deg, 1)]),
            value=edges.yaw_rad, unit="rad", plots=(plot,),
        )  # fmt: skip


def _of_ranges(case: Case, sensor: str, found: Facing) -> Iterator[Suspect]:
    """A disagreement of the two sensors: as a bias of the thin beam, or as a factor of the cone."""
    residual_m, distance_m = found.residual_m, found.distance_m
    bias_m = float(np.median(residual_m))
    if abs(bias_m) < _BIAS_M or abs(bias_m) < _SURE * found.error_m:
        return
    factor = float(np.median(residual_m / distance_m))
    strays = [np.median(np.abs(residual_m - each)) for each in (bias_m, factor * distance_m)]
    thin = case.thin[0]
    plot = Plot(
        f"{sensor} against the walls of {thin}", "distance of the wall (m)", "residual (cm)",
        points=np.column_stack([distance_m, 100.0 * residual_m]),
    )  # fmt: skip
    evidence = (
        f"where {sensor} has a wall of {thin} before it, it measures "
        f"{100 * abs(bias_m):.1f} cm {'more' if bias_m > 0 else 'less'} (median of "
        f"{len(residual_m)} pings)",
        f"which of the two errs, these readings cannot tell: {thin} may read "
        f"{100 * abs(bias_m):.1f} cm {'short' if bias_m > 0 else 'long'}, or {sensor} "
        f"{'long' if bias_m > 0 else 'short'}, or one of them sits farther ahead",
    )
    way = "long" if (factor if strays[1] < strays[0] else -bias_m) > 0 else "short"
    if strays[1] < strays[0]:
        known = case.placed.sensors[sensor].range_scale
        yield Suspect(
            "range", sensor, f"{sensor} reads {100 * abs(factor):.1f} % {way} against {thin}",
            evidence, 2.0 * abs(bias_m), "possible",
            settings=_sensor(sensor, range_scale=round(known * (1.0 + factor), 4)),
            value=1.0 + factor, unit="times", plots=(plot,),
        )  # fmt: skip
        return
    known = case.placed.sensors[thin].range_bias_m
    yield Suspect(
        "range", thin, f"{thin} reads {100 * abs(bias_m):.1f} cm {way} against {sensor}", evidence,
        2.0 * abs(bias_m), "possible",
        settings=_sensor(thin, range_bias_m=round(known - bias_m, 4)),
        value=-bias_m, unit="m", plots=(plot,),
    )  # fmt: skip


def _sensor(name: str, **keys: object) -> Settings:
    return {"sensors": {name: keys}}
