"""The causes that are looked for, one file each; a new one is named here."""

from __future__ import annotations

from mapping.diagnosis.causes.channels import Channels
from mapping.diagnosis.causes.cones import Cones
from mapping.diagnosis.causes.cross_talk import CrossTalk
from mapping.diagnosis.causes.headings import Drift, Headings
from mapping.diagnosis.causes.interface import Cause
from mapping.diagnosis.causes.mirrors import Mirrors
from mapping.diagnosis.causes.mount import Mount
from mapping.diagnosis.causes.pose_time import PoseTime
from mapping.diagnosis.causes.poses import Poses
from mapping.diagnosis.causes.ranges import Ranges
from mapping.diagnosis.causes.silence import Silence
from mapping.diagnosis.causes.smoothing import Smoothing
from mapping.diagnosis.causes.wrong_echoes import WrongEchoes

CAUSES: tuple[Cause, ...] = (
    Channels(), Silence(), Poses(), PoseTime(), Headings(), Drift(), Mount(), Ranges(), Cones(),
    CrossTalk(), Mirrors(), Smoothing(), WrongEchoes(),
)  # fmt: skip
