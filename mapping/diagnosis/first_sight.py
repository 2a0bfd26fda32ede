"""What can be seen of a session without a search, as each map and ``info`` look at it.

Of the causes only those are loaded that need no search: a small session is mapped in the time that
all of them take.
"""

from __future__ import annotations

from mapping.config import MappingConfig
from mapping.diagnosis.causes.channels import Channels
from mapping.diagnosis.causes.interface import Cause, Evidence
from mapping.diagnosis.causes.poses import Poses
from mapping.diagnosis.causes.silence import Silence
from mapping.placed_session import PlacedSession

AT_ONCE: tuple[Cause, ...] = (Channels(), Silence(), Poses())  # those that have ``suspects``
MOST_LOOKED_AT = 200_000  # readings: more take a while to go through once more


def at_first_sight(placed: PlacedSession, config: MappingConfig) -> str:
    """The worst that can be seen without a search, in a line; empty: nothing."""
    evidence = Evidence.of(placed, config)
    found = [suspect for cause in AT_ONCE for suspect in cause.suspects(evidence)]
    return max(found, key=lambda suspect: suspect.cost).text if found else ""


def worst_line(placed: PlacedSession, config: MappingConfig) -> str:
    """The same for people, with what tells more; empty where a session is too long to look at."""
    if placed.counts.readings > MOST_LOOKED_AT:
        return ""
    text = at_first_sight(placed, config)
    return f"{text}: see echogrid diagnose" if text else ""
