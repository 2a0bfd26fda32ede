"""The temp grids of many readings → the map of a layer.

``UPDATE_RULES`` names what there is; ``start`` makes the empty map of a rule, a ``MapState`` that
merges one temp grid after the other and hands out the layer.
"""

from mapping.update_rules.rules import (
    CLAMP,
    UPDATE_RULES,
    UpdateRule,
    combine_masses,
    log_odds,
    rule_of,
    share_of_largest,
    unit_gives_start,
)
from mapping.update_rules.state import MapState, start

__all__ = [
    "CLAMP",
    "UPDATE_RULES",
    "MapState",
    "UpdateRule",
    "combine_masses",
    "log_odds",
    "rule_of",
    "share_of_largest",
    "start",
    "unit_gives_start",
]
