"""What the walls of thin beams tell of a sonar: its cone, and its yaw."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.cross_talk import talking
from mapping.diagnosis.causes.interface import Cause, Plot, Settings, Suspect
from mapping.diagnosis.facing import Acceptance, acceptance, walls_of
from mapping.diagnosis.hypothesis import Hypothesis
from recorder.messages import Radiation

_WIDER, _NARROWER = 1.4, 0.75  # times what is configured
_YAW_RAD = math.radians(3.5)
_YAW_ERROR_RAD = math.radians(2.0)  # as planted yaws were found


class Cones(Cause):
    """Each wide beam against the walls that the thin ones have drawn, mended already."""

    name, title = "cones", "a sonar's cone or yaw is not what it should be"

    def examine(self, case: Case, hypothesis: Hypothesis) -> Iterator[Suspect]:
        """One sonar after the other."""
        walls, talk = walls_of(case, hypothesis), talking(case, hypothesis)
        for sensor in case.wide:
            if case.placed.sensors[sensor].radiation is not Radiation.ULTRASOUND:
                continue  # light that is averaged over a cone
            edges = acceptance(case, hypothesis, sensor, walls)
            if edges is not None:
                yield from _of_edges(case, hypothesis, sensor, edges, sensor in talk)


def _of_edges(
    case: Case, hypothesis: Hypothesis, sensor: str, edges: Acceptance, talks: bool
) -> Iterator[Suspect]:
    """One that ``talks`` measures few walls at the edges of its cone: others are louder there."""
    known = next(each for each in case.readings.sensors if each.name == sensor)
    times = 2.0 * edges.half_width_rad / known.beam_width_rad
    plot = Plot(
        f"how often {sensor} measures a wall", "the wall lies to the left of its axis (degrees)",
        "share of the pings",
        line=np.column_stack([np.degrees(edges.angle_rad), edges.share])[np.isfinite(edges.share)],
        mark=math.degrees(edges.yaw_rad),
    )  # fmt: skip
    if times > _WIDER or (times < _NARROWER and not talks):
        width_deg = math.degrees(2.0 * edges.half_width_rad)
        yield Suspect(
            "beam", sensor,
            f"the beam of {sensor} is {width_deg:.0f} degrees wide, not "
            f"{math.degrees(known.beam_width_rad):.0f}",
            _evidence(edges),
            0.1 * abs(math.log(max(times, 0.1))), "likely" if edges.yaw_is_seen else "possible",
            settings=_sensor(sensor, beam_width_deg=round(max(width_deg, 2.0), 1)),
            value=times, unit="times", plots=(plot,),
        )  # fmt: skip
    if abs(edges.yaw_rad) > _YAW_RAD:
        mount, change = case.session.mount(sensor), hypothesis.of(sensor)
        yaw_deg, error_deg = math.degrees(edges.yaw_rad), math.degrees(_YAW_ERROR_RAD)
        yield Suspect(
            "mount", sensor,
            f"{sensor} sits turned by {abs(yaw_deg):.0f} +- {error_deg:.0f} degrees to the "
            f"{'left' if yaw_deg > 0 else 'right'}",
            (*_evidence(edges),
             f"by the walls of {' and '.join(case.thin)}: turned as far the other way, that would "
             "look the same"),
            0.005 * abs(yaw_deg), "likely",
            settings=_sensor(sensor, mount=[
                round(mount.x_m + change.x_m, 4), round(mount.y_m + change.y_m, 4),
                round(math.degrees(mount.heading_rad) + yaw_deg, 1)]),
            value=edges.yaw_rad, unit="rad",
            error=_YAW_ERROR_RAD, plots=(plot,),
        )  # fmt: skip


def _evidence(edges: Acceptance) -> tuple[str, ...]:
    if not edges.yaw_is_seen:
        return (
            f"it measures walls up to {math.degrees(edges.edge_rad):.0f} degrees to one side of "
            "its axis; the other edge never shows, so its yaw is taken as it is stated",
        )
    left, right = (math.degrees(edges.edge_rad + sign * edges.yaw_rad) for sign in (1.0, -1.0))
    return (
        f"it measures walls up to {left:.0f} degrees to the left and {right:.0f} to the right of "
        "its axis",
    )


def _sensor(name: str, **keys: object) -> Settings:
    return {"sensors": {name: keys}}
