"""Lines where the walls are: the grid says which wall, the raw points say where.

Each line of a grid is fitted again to the points that it explains (:mod:`.refit`); walls that a
narrow ranger showed and the grid did not are added from its own lines. Pieces of one wall become
one: those with a short gap, and those whose gap has points of the same line too. Then the lines are
gone through, what explains most readings first. A line is left out when better ones run along most
of it, when better ones explain nearly all that it does (an echo reaches a corner, or what lies
behind a wall, by way of the wall), when readings went past where it should be, and when it is a
short cut across a corner that the walls of both sides reach. What no reading speaks for or
against stays as the grid has it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Segment
from mapping.config import SegmentsSection
from mapping.grid import read_only
from mapping.segments.least_squares import FittedLine, covariance_of, normal_form
from mapping.segments.refit import Refit, refit, settle
from mapping.segments.runs import meet_at_corners
from mapping.segments.sightings import Sightings
from mapping.segments.stages import Drop, Move, Observer, place_of
from mapping.segments.stretch import Stretch
from recorder.numbers import distinct

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_WITHIN = 2.0  # of epsilon: how far a grid line may lie from its wall
_BRIDGE_M = 1.0  # longer gaps in a wall stay gaps, whatever lies in them
_BRIDGE_CELL_M = 0.1
_FILLED = 0.5  # of the cells of a gap
_SAME_M, _SAME_RAD = 0.05, math.radians(20.0)
_SAME = 0.6  # of a line's length along better ones
_OWN, _OWN_SHARE = 3, 0.1  # readings that no better line explains
_AGAINST, _AGAINST_SHARE, _AGAINST_LONG = 2, 0.1, 0.5  # of its own; of a long line
_BEHIND_M = 0.03
_CROWD, _CROWDED, _PLACE_M = 8, 0.4, 0.05
_SHORT_M = 0.7
_TIGHT_M, _TIGHT_SHARE = 0.015, 0.015  # of the wall, for a place of it to be seen
_CORNER_M, _CORNER_CUT_M, _CORNER_GAP_M = 0.3, 0.5, 0.2
_CORNER_SINE = 0.5
_ALONG = math.cos(math.radians(10.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Wall:
    """A line, the segment that it began as, and its fit, if it has any."""

    stretch: Stretch
    given: Segment
    fit: Refit | None

    def settled(self, sightings: Sightings, min_points: int) -> _Wall:
        """Fitted to its points, if there are enough."""
        fit = settle(self.stretch, sightings, min_points=min_points)
        return self if fit is None else replace(self, stretch=fit.stretch, fit=fit)


def segments_at_walls(
    lines: Sequence[Segment],
    raw_lines: Sequence[Segment],
    sightings: Sightings,
    config: SegmentsSection,
    *,
    layer: str,
    observe: Observer | None = None,
) -> list[Segment]:
    """The lines of a layer's grid where the readings have the walls, the longest first.

    ``raw_lines`` are those that its narrow rangers showed by themselves, ``sightings`` what its
    sensors met. A segment that was fitted again has the covariance, rms and number of the points
    that it was fitted to; the others are those that came.
    """
    if len(sightings) == 0:
        return list(lines)
    walls = [_refitted(line, sightings, config) for line in lines]
    if config.merge != "none":
        mine = [replace(line, layer=layer, source="grid") for line in raw_lines]
        walls += [_Wall(_stretch_of(line), line, None) for line in mine]
        walls = _joined(walls, sightings, config, _has_no_gap(config.gap_m))
        walls = _joined(walls, sightings, config, _has_filled_gap(sightings))
    _report_moves(walls, observe)
    kept = [wall for wall in _standing(walls, sightings, observe)
            if wall.stretch.length_m >= config.min_length_m or wall.fit is None]  # fmt: skip
    # Two short lines that cross may be cut at their corner until nothing is left of them.
    lines = [line for line in _with_corners(kept, config)
             if line.length_m >= 0.5 * config.min_length_m]  # fmt: skip
    return sorted(lines, key=lambda one: -one.length_m)


def _stretch_of(segment: Segment) -> Stretch:
    return Stretch.between(np.array(segment.start_m), np.array(segment.end_m))


def _refitted(line: Segment, sightings: Sightings, config: SegmentsSection) -> _Wall:
    stretch = _stretch_of(line)
    within_m = _WITHIN * config.epsilon_m
    fit = refit(stretch, sightings, within_m=within_m, min_points=config.min_points)
    return _Wall(stretch if fit is None else fit.stretch, line, fit)


Test = Callable[[Stretch, Stretch], bool]


def _has_no_gap(gap_m: float) -> Test:
    return lambda a, b: a.continues(b, gap_m)


def _has_filled_gap(sightings: Sightings) -> Test:
    """Whether the gap between two stretches of one line has points of that line, too."""

    def test(a: Stretch, b: Stretch) -> bool:
        if not a.continues(b, _BRIDGE_M):
            return False
        whole = a.with_(b)
        begin, end = (a if a.length_m >= b.length_m else b).gap_to(
            b if a.length_m >= b.length_m else a
        )
        if end <= begin:
            return True
        places, can = sightings.places_on(whole)
        t, off = whole.frame_of(places)
        near = can & (np.abs(off) < np.maximum(0.02, 0.02 * sightings.range_m))
        inside = t[near & (t > begin) & (t < end)]
        cells = max(round((end - begin) / _BRIDGE_CELL_M), 1)
        filled = len(distinct(np.floor((inside - begin) / (end - begin) * cells)))
        past = int(sightings.against(whole.part(begin, end)).sum())
        return filled >= _FILLED * cells and past <= _AGAINST_SHARE * len(inside)

    return test


def _joined(
    walls: list[_Wall], sightings: Sightings, config: SegmentsSection, one: Test
) -> list[_Wall]:
    """Pieces of one wall as one, fitted to the points of all."""
    done: list[_Wall] = []
    waiting = sorted(walls, key=lambda wall: wall.stretch.length_m)
    while waiting:
        wall = waiting.pop()
        alone, grows = wall.stretch, True
        while grows:
            partners = [k for k, other in enumerate(waiting) if one(wall.stretch, other.stretch)]
            grows = bool(partners)
            if partners:
                other = waiting.pop(partners[-1])  # the longest
                stretch = wall.stretch.with_(other.stretch)
                wall = replace(wall, stretch=stretch)
        same = wall.stretch is alone and wall.fit is not None
        done.append(wall if same else wall.settled(sightings, config.min_points))
    return done


def _standing(walls: list[_Wall], sightings: Sightings, observe: Observer | None) -> list[_Wall]:
    """The walls that the readings speak for, and those that none speaks against."""
    explained = [sightings.explained_by(wall.stretch) for wall in walls]
    many = np.array([int(flags.sum()) for flags in explained], np.int64)
    taken = np.zeros(len(sightings), np.bool_)
    lit = not sightings.arc.all()  # sonars alone see few places of any wall
    kept: list[_Wall] = []
    for k in np.argsort(-many, kind="stable").tolist():
        wall, better = walls[k].stretch, [one.stretch for one in kept]
        own = _in_sight(wall, better, sightings.of(explained[k] & ~taken))
        past = int(sightings.against(wall).sum())
        if (
            wall.share_along(better, _SAME_M, _SAME_RAD) >= _SAME
            or (past >= _AGAINST and past >= _bearable(wall) * len(own))
            or (many[k] >= _OWN and len(own) < max(_OWN, _OWN_SHARE * many[k]))
            or (lit and _in_few_places(wall, own))
            or _cuts_a_corner(wall, better)
        ):
            if observe is not None:
                observe(Drop(*(place_of(end) for end in wall.ends_m)))
            continue
        taken |= explained[k]
        kept.append(walls[k])
    return kept


def _bearable(wall: Stretch) -> float:
    """How many readings may go past, for each of its own: strays do, by a long wall that stands."""
    return _AGAINST_SHARE if wall.length_m <= _SHORT_M else _AGAINST_LONG


def _in_sight(wall: Stretch, better: list[Stretch], sightings: Sightings) -> Sightings:
    """The readings that reach the wall without going through a better one."""
    ends = sightings.ends_on(wall)
    blocked = np.zeros(len(sightings), np.bool_)
    for other in better:
        blocked |= other.crossed(sightings.from_m, ends, _BEHIND_M)
    return sightings.of(~blocked)


def _in_few_places(wall: Stretch, own: Sightings) -> bool:
    """Whether it is short, and its readings crowd in few places of it, as stray echoes do.

    So many readings, thrown at random, would leave exp(-readings / places) of the places empty.
    """
    if len(own) < _CROWD or wall.length_m > _SHORT_M:
        return False
    places, can = own.places_on(wall)
    t, off = wall.frame_of(places)
    on_wall = can & (np.abs(off) < np.maximum(_TIGHT_M, _TIGHT_SHARE * own.range_m))
    cells = max(math.ceil(wall.length_m / _PLACE_M), 1)
    at = np.floor((t[on_wall | ~own.arc] - wall.begin_m) * (cells / max(wall.length_m, 1e-9)))
    filled = len(distinct(at[(at >= 0) & (at < cells)])) / cells
    return filled < _CROWDED * (1.0 - math.exp(-len(own) / cells))


def _cuts_a_corner(wall: Stretch, better: list[Stretch]) -> bool:
    """Whether it is a short line across a corner which the longer lines of both sides reach."""
    if wall.length_m > _CORNER_CUT_M:
        return False
    sides = [
        one for one in better
        if one.length_m > wall.length_m and abs(float(one.along @ wall.along)) < _ALONG
    ]  # fmt: skip
    for k, one in enumerate(sides):
        for other in sides[:k]:
            corner = one.crossing(other, _CORNER_SINE)
            if corner is None or math.dist(corner, wall.middle_m) > _CORNER_M:
                continue
            gaps = [np.hypot(*(side.ends_m - corner).T).min() for side in (one, other)]
            if max(gaps) < _CORNER_GAP_M:
                return True
    return False


def _with_corners(walls: list[_Wall], config: SegmentsSection) -> list[Segment]:
    fitted = [
        FittedLine(_points_of(wall), wall.stretch.place_m, wall.stretch.along, *wall.stretch.ends_m)
        for wall in walls
    ]
    lines = meet_at_corners(fitted, config) if config.merge != "none" else fitted
    return [_segment(wall, line) for wall, line in zip(walls, lines, strict=True)]


def _points_of(wall: _Wall) -> Floats:
    return wall.stretch.ends_m if wall.fit is None else wall.fit.points_m


def _segment(wall: _Wall, line: FittedLine) -> Segment:
    start, end = place_of(line.start_m), place_of(line.end_m)
    fit = wall.fit
    if fit is None:
        return replace(wall.given, start_m=start, end_m=end)
    rho, alpha, normal = normal_form(line)
    covariance = covariance_of(fit.points_m, normal, fit.variances_m2, fit.weights)
    read_only(covariance)
    return Segment(
        layer=wall.given.layer, source="grid", border=wall.given.border, start_m=start, end_m=end,
        rho_m=rho, alpha_rad=alpha, covariance=covariance, rms_m=fit.rms_m,
        points=len(fit.points_m),
    )  # fmt: skip


def _report_moves(walls: list[_Wall], observe: Observer | None) -> None:
    if observe is None:
        return
    for wall in walls:
        if wall.fit is not None:
            before = np.array([wall.given.start_m, wall.given.end_m]).mean(axis=0)
            moved = abs(float(wall.stretch.frame_of(before[None])[1][0]))
            observe(Move(wall.given.start_m, wall.given.end_m, moved))
