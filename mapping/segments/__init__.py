"""From points to lines: raw points of a ranger or a scan, or the borders of a grid.

Points become chains (:mod:`.chains`), a method of the table (:mod:`.methods`) finds lines in them
and :mod:`.least_squares` gives the covariance of each. Lines of a grid then move to where the raw
points have their walls (:mod:`.walls`). What happens on the way is reported stage by stage
(:mod:`.stages`).
"""

from __future__ import annotations

from mapping.segments.free_space import reachable_cells
from mapping.segments.grid_lines import segments_from_borders
from mapping.segments.methods import LINE_METHODS, LineMethod
from mapping.segments.ranger_lines import segments_of_ranger
from mapping.segments.raw import (
    segments_from_points,
    segments_from_scan,
    stages_of_points,
)
from mapping.segments.ridge import segments_from_grid, segments_from_ridge
from mapping.segments.scan_lines import of_lidar_only, scans_of, segments_of_scans
from mapping.segments.sightings import NARROW_RAD, SightingLog
from mapping.segments.stages import Corner, Fit, Merge, Observer, Split, Stage, line_stages
from mapping.segments.walls import segments_at_walls

__all__ = [
    "LINE_METHODS",
    "NARROW_RAD",
    "Corner",
    "Fit",
    "LineMethod",
    "Merge",
    "Observer",
    "SightingLog",
    "Split",
    "Stage",
    "line_stages",
    "of_lidar_only",
    "reachable_cells",
    "scans_of",
    "segments_at_walls",
    "segments_from_borders",
    "segments_from_grid",
    "segments_from_points",
    "segments_from_ridge",
    "segments_from_scan",
    "segments_of_ranger",
    "segments_of_scans",
    "stages_of_points",
]
