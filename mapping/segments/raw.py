"""Lines from raw points: those of a ranger along a robot's path, or one scan of a laser."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mapping.artifacts import Segment
from mapping.beams import Beam
from mapping.config import SegmentsSection
from mapping.segments.chains import chains_from_points, chains_from_scan
from mapping.segments.least_squares import (
    FittedLine,
    FloatArray,
    segment_of,
    variances_from_beams,
    variances_from_residuals,
)
from mapping.segments.methods import line_method
from mapping.segments.stages import Observer, Stage


def segments_from_points(
    points_m: FloatArray,
    config: SegmentsSection,
    *,
    layer: str,
    closed: bool | None = None,
    gap_m: float | None = None,
    origin_m: tuple[float, float] | None = None,
    observe: Observer | None = None,
) -> list[Segment]:
    """Lines through the obstacle points (N, 2) of one ranger, metres, in the order of time.

    ``config.order`` may put them in another order first: by bearing around ``origin_m`` (default:
    their mean), or from nearest to nearest. Neighbours more than ``gap_m`` (default: the
    configuration's) apart are not joined. ``closed`` None: where the two ends meet. Points that
    are not finite are left out. ``observe`` is called with every stage. Raises BadInput for a
    method that is not known.
    """
    points = np.asarray(points_m, np.float64).reshape(-1, 2)
    method = line_method(config.method)
    chains = chains_from_points(
        points,
        order=config.order,
        gap_m=config.gap_m if gap_m is None else gap_m,
        closed=False if config.wrap == "off" else closed,
        origin_m=_mean(points) if origin_m is None else np.array(origin_m),
    )
    return [raw_segment(line, layer, config) for line in method.lines(chains, config, observe)]


def raw_segment(line: FittedLine, layer: str, config: SegmentsSection) -> Segment:
    """The artifact of a line through raw points, its noise estimated from its residuals."""
    least_m = config.epsilon_m / 3.0 if len(line.points_m) < 5 else 1e-6
    variances = variances_from_residuals(line, least_m)
    return segment_of(line, layer=layer, source="raw", border=None, variances_m2=variances)


def segments_from_scan(
    beam: Beam,
    config: SegmentsSection,
    *,
    sigma_m: float | None = None,
    observe: Observer | None = None,
) -> list[Segment]:
    """Lines through the returns of one laser scan, in the map frame.

    Returns are grouped by the adaptive breakpoint rule, for noise of ``sigma_m`` along the beams
    (None: a quarter of epsilon, and the covariances from the residuals).
    """
    noise_m = config.epsilon_m / 4.0 if sigma_m is None else sigma_m
    method = line_method(config.method)
    chains = chains_from_scan(beam.ranges_m, beam.bearings_rad, sigma_m=noise_m)
    pose = beam.world_from_sensor
    placed = type(chains)(pose.transform(chains.points_m), chains.offsets, chains.closed)
    origin = np.array([pose.x_m, pose.y_m])
    return [
        segment_of(
            line,
            layer=beam.layer,
            source="raw",
            border=None,
            variances_m2=variances_from_beams(line, origin, sigma_m),
        )
        for line in method.lines(placed, config, observe)
    ]


def stages_of_points(points_m: FloatArray, config: SegmentsSection) -> Iterator[Stage]:
    """Every split, merge, fit and corner on the way from raw points to lines, in turn."""
    stages: list[Stage] = []
    segments_from_points(points_m, config, layer="", observe=stages.append)
    yield from stages


def _mean(points: FloatArray) -> FloatArray:
    finite = points[np.isfinite(points).all(axis=1)]
    return finite.mean(axis=0) if len(finite) else np.zeros(2)
