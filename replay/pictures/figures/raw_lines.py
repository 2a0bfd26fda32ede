"""Lines straight from the raw points: split and merge, fits, corners, the incremental method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from mapping.config import SegmentsSection
from mapping.segments import Corner, Fit, Merge, Split, Stage
from mapping.segments.chains import Chains, chains_from_points
from mapping.segments.least_squares import FittedLine
from mapping.segments.methods import line_method
from replay.pictures import style
from replay.pictures.figures.bench import Bench, Role
from replay.pictures.figures.figure import Drawing, Figure, LeftOut
from replay.pictures.figures.shading import blank, dots, path, walls
from replay.pictures.parts import Box, Dots, Floats, Mark, Strokes, Trail

LINES, SPLIT, INCREMENTAL = "Line Extraction", "Split & Merge", "Incremental"
SPLITS_M, SONAR_RMS_M, NARROW_RMS_M = (0.01, 0.03, 0.16), (0.015, 0.03, 0.09), (0.03, 0.09, 0.18)
_EPSILON_M = 0.06
_S = TypeVar("_S", Split, Fit, Merge, Corner)


@dataclass(frozen=True, slots=True)
class Lined:
    """The lines of some chains of points, and every stage on the way to them."""

    chains: Chains
    lines: list[FittedLine]
    stages: list[Stage]

    def of(self, kind: type[_S]) -> list[_S]:
        """The stages of one kind."""
        return [each for each in self.stages if isinstance(each, kind)]


def chained(bench: Bench, role: Role, **changes: Any) -> tuple[Chains, SegmentsSection]:
    """The raw points of a role in the order of time, each once, and the settings of its lines.

    Raises LeftOut for too few of them.
    """
    points, _ = bench.points(role)
    first = np.sort(np.unique(points, axis=0, return_index=True)[1])
    points = points[first]
    low, high = bench.frame.corners_m
    points = points[((points >= low) & (points <= high)).all(axis=1)]
    if len(points) < 10:
        raise LeftOut(f"{role.sensor.name} has {len(points)} obstacle points: too few for lines")
    section = SegmentsSection.model_validate(
        {"epsilon_m": _EPSILON_M, "merge": "none", "wrap": "off", "min_length_m": 0.05,
         "min_points": 3, **changes}
    )  # fmt: skip
    gap_m = section.raw_gap_m * max(1.0, max(bench.frame.width_m, bench.frame.height_m) / 5.0)
    chains = chains_from_points(
        points, order="time", gap_m=gap_m, closed=False, origin_m=points.mean(axis=0)
    )
    return chains, section


def lined(bench: Bench, role: Role, **changes: Any) -> Lined:
    """The lines of a role's raw points, by split and merge unless set otherwise."""
    chains, section = chained(bench, role, **changes)
    stages: list[Stage] = []
    lines = line_method(section.method).lines(chains, section, stages.append)
    return Lined(chains, lines, stages)


def pieces_of(chains: Chains, splits: Sequence[Split]) -> Floats:
    """What the splitting left, (K, 2, 2): each chain as a piece, and each cut makes two of one."""
    ends = [
        (tuple(chains.points_m[a].tolist()), tuple(chains.points_m[b - 1].tolist()))
        for a, b in zip(chains.offsets[:-1], chains.offsets[1:], strict=True)
        if b - a >= 2
    ]
    pieces = dict.fromkeys(ends)
    for split in splits:
        whole = (split.start_m, split.end_m)
        if whole in pieces:
            del pieces[whole]
        pieces[split.start_m, split.at_m] = pieces[split.at_m, split.end_m] = None
    return np.array(list(pieces), np.float64).reshape(-1, 2, 2)


def _strokes(lines: Floats, label: str, width_pt: float = 1.6) -> list[Mark]:
    return [Strokes(lines, style.FOUND_WALL, width_pt, label)] if len(lines) else []


def _ends(lines: Sequence[FittedLine]) -> Floats:
    ends = [(line.start_m, line.end_m) for line in lines]
    return np.array(ends, np.float64).reshape(-1, 2, 2)


def _under(bench: Bench, role: Role, points_m: Floats) -> list[Mark]:
    return [*walls(bench), dots(bench, role, points_m, 2.0)]


def _idea(bench: Bench) -> Drawing:
    role = bench.any_ranger
    found = lined(bench, role, merge="joint-fit", min_length_m=0.1)
    points = found.chains.points_m
    panels = (
        blank(bench, "points in their order", [*path(bench), *_under(bench, role, points)]),
        blank(bench, "lines through them",
              [*_under(bench, role, points), *_strokes(_ends(found.lines), "lines found", 2.2)]),
    )  # fmt: skip
    caption = (
        f"Without a grid: {len(points):,} points of {role.sensor.name} in the order in which they "
        f"were measured become {len(found.lines)} straight lines. It is quick, but takes every "
        "reading at its word."
    )
    return Drawing(panels, caption)


def _first_split(bench: Bench) -> Drawing:
    role = bench.any_ranger
    found = lined(bench, role)
    splits = found.of(Split)
    if not splits:
        raise LeftOut(f"no chain of points of {role.sensor.name} bends by {_EPSILON_M:g} m")
    split = max(splits, key=lambda s: s.distance_m)
    start, end, at = (np.array(each) for each in (split.start_m, split.end_m, split.at_m))
    along = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
    foot = start + along * float((at - start) @ along)
    marks: list[Mark] = [
        *_under(bench, role, found.chains.points_m),
        Trail(np.array([start, end]), style.PALE_INK, 1.2, "chord", dashed=True),
        Strokes(np.array([[at, foot]]), style.MORE_OCCUPIED, 1.2, "farthest from it"),
        Strokes(np.array([[start, at], [at, end]]), style.FOUND_WALL, 1.6, "the two parts"),
        Dots(np.array([at]), style.MORE_OCCUPIED, 6.0, "where it is cut"),
    ]  # fmt: skip
    caption = (
        f"The point farthest from the chord lies {split.distance_m:.2f} m away, more than "
        f"ε = {100 * _EPSILON_M:g} cm: the set is cut there, and both parts are treated alike."
    )
    frame = Box.around(np.array([start, at, end]), 0.25, _least(bench))
    return Drawing((blank(bench, "", marks, frame),), caption)


def _recursion(bench: Bench) -> Drawing:
    role = bench.any_ranger
    found = lined(bench, role)
    splits = found.of(Split)
    counts = sorted({0, min(2, len(splits)), len(splits) // 2, len(splits)})
    panels = []
    for count in counts:
        pieces = pieces_of(found.chains, splits[:count])
        marks = [*_under(bench, role, found.chains.points_m), *_strokes(pieces, "pieces")]
        panels.append(blank(bench, f"{count} cuts: {len(pieces)} pieces", marks))
    caption = (
        f"Cut again and again until no point lies more than {100 * _EPSILON_M:g} cm from its "
        f"chord: {len(splits)} cuts. Chains are broken where neighbours lie far apart."
    )
    return Drawing(tuple(panels), caption, columns=2)


def _splits(bench: Bench, role: Role) -> Drawing:
    panels, counts = [], []
    for epsilon_m in SPLITS_M:
        found = lined(bench, role, epsilon_m=epsilon_m)
        pieces = pieces_of(found.chains, found.of(Split))
        counts.append(len(pieces))
        marks = [*_under(bench, role, found.chains.points_m), *_strokes(pieces, "pieces")]
        panels.append(blank(bench, f"ε = {100 * epsilon_m:g} cm", marks))
    caption = (
        f"The points of {role.sensor.name} split at 1, 3 and 16 cm: {counts[0]:,}, {counts[1]:,} "
        f"and {counts[2]:,} pieces. A small ε follows the noise, a large one cuts corners."
    )
    return Drawing(tuple(panels), caption)


def _splits_sonar(bench: Bench) -> Drawing:
    return _splits(bench, bench.sonar)


def _splits_narrow(bench: Bench) -> Drawing:
    return _splits(bench, bench.narrow)


def _longest(found: Lined, role: Role) -> FittedLine:
    if not found.lines:
        raise LeftOut(f"no line fits the points of {role.sensor.name}")
    return max(found.lines, key=lambda line: len(line.points_m))


def _fit(bench: Bench) -> Drawing:
    role = bench.any_ranger
    line = _longest(lined(bench, role), role)
    points = line.points_m
    chord = np.array([[points[0], points[-1]]])
    fitted = np.array([[line.start_m, line.end_m]])
    d = (points - line.centre_m) @ line.normal
    feet = np.stack([points, points - d[:, None] * line.normal], axis=1)
    frame = Box.around(np.vstack([points, fitted[0]]), 0.1, _least(bench))
    marks: list[Mark] = [
        Strokes(feet, style.PALE_INK, 0.7, "distances from it"),
        Strokes(chord, style.MORE_FREE, 1.4, "chord of the ends"),
        Strokes(fitted, style.FOUND_WALL, 2.0, "best fit"), dots(bench, role, points, 4.0),
    ]  # fmt: skip
    caption = (
        f"{len(points)} points of one piece. Its chord depends on two points alone; the line of "
        f"the least squares on all, with an rms of {1000 * line.rms_m:.1f} mm. Distances are "
        "taken square to the line, so that upright walls fit as well."
    )
    return Drawing((blank(bench, "", marks, frame),), caption)


def _least(bench: Bench) -> float:
    return 0.05 * max(bench.frame.width_m, bench.frame.height_m)


def _fits(bench: Bench) -> Drawing:
    role = bench.any_ranger
    found = lined(bench, role, corner_reach_m=0.0)
    reach = max(bench.frame.width_m, bench.frame.height_m) * 0.06
    drawn_out = [
        (line.start_m - reach * line.along, line.end_m + reach * line.along) for line in found.lines
    ]
    ends = np.array(drawn_out, np.float64).reshape(-1, 2, 2)
    marks = [
        *_under(bench, role, found.chains.points_m),
        *_strokes(ends, "fitted lines, longer", 1.2),
    ]
    caption = (
        f"A line of least squares for each piece of {role.sensor.name}, {len(found.lines)} in all, "
        "drawn longer than its points: neighbours cross."
    )
    return Drawing((blank(bench, "", marks),), caption)


def _corners(bench: Bench) -> Drawing:
    role = bench.any_ranger
    found = lined(bench, role)
    places = np.array([corner.at_m for corner in found.of(Corner)]).reshape(-1, 2)
    marks: list[Mark] = [
        *_under(bench, role, found.chains.points_m),
        *_strokes(_ends(found.lines), "lines to their corners"),
    ]  # fmt: skip
    if len(places):
        marks.append(Dots(places, style.MORE_OCCUPIED, 4.0, "where neighbours cross"))
    caption = (
        f"Neighbouring lines end where they cross: {len(places)} corners of {len(found.lines)} "
        "lines. The first and the last of each chain have no neighbour on one side."
    )
    return Drawing((blank(bench, "", marks),), caption)


def _wrap(bench: Bench) -> Drawing:
    """The points around one place: the chain that comes nearest to going round."""
    role = bench.any_ranger
    points, where = bench.points(role)
    spot = np.median(where, axis=0)
    low, high = bench.frame.corners_m
    points = points[((points >= low) & (points <= high)).all(axis=1)]
    if len(points) < 10:
        raise LeftOut(f"{role.sensor.name} has too few points to go round a place")
    panels, counts = [], []
    for wrap, title in (
        ("off", "not joined"),
        ("on", "first and last joined"),
        ("drop", "dropped"),
    ):
        section = SegmentsSection.model_validate(
            {"epsilon_m": 0.16, "merge": "none", "wrap": wrap, "min_points": 3,
             "min_length_m": 0.05, "corner_reach_m": 0.5}
        )  # fmt: skip
        chains = chains_from_points(
            points, order="bearing", gap_m=1e6, closed=wrap != "off", origin_m=spot
        )
        lines = line_method("split-and-merge").lines(chains, section, None)
        counts.append(len(lines))
        marks: list[Mark] = [
            *_under(bench, role, points), *_strokes(_ends(lines), "lines", 1.4),
            Dots(np.array([spot]), style.INK, 6.0, "the place gone round"),
        ]  # fmt: skip
        panels.append(blank(bench, title, marks))
    caption = (
        "All points by their bearing around one place: is the last line a neighbour of the first? "
        f"Not joined there are {counts[0]} lines, joined {counts[1]}, and {counts[2]} where both "
        "are left out, since a line across the seam may be none."
    )
    return Drawing(tuple(panels), caption)


def _merged(bench: Bench) -> Drawing:
    role = bench.any_ranger
    before = lined(bench, role, epsilon_m=0.03)
    after = lined(bench, role, epsilon_m=0.03, merge="joint-fit")
    panels = []
    for title, found in (("split", before), ("merged", after)):
        under = _under(bench, role, found.chains.points_m)
        marks = [*under, *_strokes(_ends(found.lines), "lines found")]
        panels.append(blank(bench, f"{title}: {len(found.lines)} lines", marks))
    caption = (
        f"Neighbours that are one line are put together: {len(after.of(Merge))} merges make "
        f"{len(before.lines)} lines of {role.sensor.name} {len(after.lines)}. They nearly line up, "
        "bend little, or end close to each other."
    )
    return Drawing(tuple(panels), caption)


def _growth(bench: Bench) -> Drawing:
    role = bench.any_ranger
    found = lined(bench, role, method="incremental", rms_m=0.03)
    line = _longest(found, role)
    chains = found.chains
    starts = np.flatnonzero((chains.points_m == line.points_m[0]).all(axis=1))
    begin = int(starts[0]) if len(starts) else 0
    count = len(line.points_m)
    frame = Box.around(chains.points_m[begin : begin + count + 12], 0.1, _least(bench))
    panels = []
    for size in sorted({max(2, count // 4), max(3, count // 2), count}):
        taken = chains.points_m[begin : begin + size]
        centre, _, rows = taken.mean(axis=0), *np.linalg.svd(taken - taken.mean(axis=0))[1:]
        along = rows[0]
        t = (taken - centre) @ along
        ends = np.array([[centre + t.min() * along, centre + t.max() * along]])
        rms = float(np.sqrt(np.mean(((taken - centre) @ rows[1]) ** 2)))
        marks: list[Mark] = [
            *_under(bench, role, chains.points_m), dots(bench, role, taken, 4.5),
            *_strokes(ends, "the line so far", 2.2),
        ]  # fmt: skip
        panels.append(blank(bench, f"{size} points: rms {100 * rms:.1f} cm", marks, frame))
    caption = (
        "The incremental way: point after point is taken into the set, and the line fitted anew, "
        "as long as the rms stays within its bound, here 3 cm. The next point begins a new line."
    )
    return Drawing(tuple(panels), caption)


def _incremental(bench: Bench, role: Role, bounds_m: Sequence[float]) -> Drawing:
    panels, counts = [], []
    for rms_m in bounds_m:
        found = lined(bench, role, method="incremental", rms_m=rms_m)
        counts.append(len(found.lines))
        under = _under(bench, role, found.chains.points_m)
        marks = [*under, *_strokes(_ends(found.lines), "lines found")]
        panels.append(blank(bench, f"rms at most {100 * rms_m:g} cm", marks))
    at = [f"{100 * each:g}" for each in bounds_m]
    caption = (
        f"The points of {role.sensor.name} by the incremental method, with bounds of {at[0]}, "
        f"{at[1]} and {at[2]} cm: {counts[0]:,}, {counts[1]:,} and {counts[2]:,} lines."
    )
    return Drawing(tuple(panels), caption)


def _incremental_sonar(bench: Bench) -> Drawing:
    return _incremental(bench, bench.sonar, SONAR_RMS_M)


def _incremental_narrow(bench: Bench) -> Drawing:
    return _incremental(bench, bench.narrow, NARROW_RMS_M)


FIGURES = (
    Figure("line-extraction", LINES, "Lines instead of a grid", _idea),
    Figure("split-once", SPLIT, "One cut", _first_split),
    Figure("split-on", SPLIT, "Cut after cut", _recursion),
    Figure("split-sonar", SPLIT, "Sonar split at 1, 3 and 16 cm", _splits_sonar),
    Figure("split-infrared", SPLIT, "Infrared split at 1, 3 and 16 cm", _splits_narrow),
    Figure("fit", SPLIT, "The line that fits best", _fit),
    Figure("fits", SPLIT, "A fit for each piece", _fits),
    Figure("intersections", SPLIT, "Neighbours that cross", _corners),
    Figure("wrap-around", SPLIT, "Wrap-around", _wrap),
    Figure("merge", SPLIT, "Neighbours merged", _merged),
    Figure("incremental-growth", INCREMENTAL, "A line that grows", _growth),
    Figure("incremental-sonar", INCREMENTAL, "Sonar at 1.5, 3 and 9 cm", _incremental_sonar),
    Figure("incremental-infrared", INCREMENTAL, "Infrared at 3, 9 and 18 cm", _incremental_narrow),
)
