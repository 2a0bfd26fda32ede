"""Fitting one line to points, and how sure the fit is of it.

A line is x cos(alpha) + y sin(alpha) = rho with rho >= 0, so that vertical walls are like any
other. *Total least squares* takes the direction of largest spread through the mean and so makes the
sum of squared perpendicular distances least; ``y-on-x`` is the chapter's y = m x + b, which makes
that of the vertical distances least and turns wrong as walls get steep.

The covariance of (rho, alpha) follows from the errors of the points across the line: with t the
place along it from the foot of the perpendicular, tau that from the mean and v the variance of
each point, d alpha = - sum(tau e) / sum(tau tau) and d rho = mean(e) + mean(t) d alpha.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Segment
from mapping.grid import read_only
from mapping.segments.stages import place_of
from recorder.geometry import wrap_angle

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FittedLine:
    """A line and the points (N, 2) that it was fitted to, in order along the chain.

    ``centre_m`` and ``along`` (a unit vector) are the line; ``start_m`` and ``end_m`` its ends,
    in the points' order; ``corners`` is which of them are crossings with a neighbour.
    """

    points_m: FloatArray
    centre_m: FloatArray
    along: FloatArray
    start_m: FloatArray
    end_m: FloatArray
    corners: tuple[bool, bool] = (False, False)

    @property
    def normal(self) -> FloatArray:
        """Unit vector to the left of the line."""
        return np.array([-self.along[1], self.along[0]])

    @property
    def residuals_m(self) -> FloatArray:
        """Signed distance of each point from the line, (N,)."""
        residuals: FloatArray = (self.points_m - self.centre_m) @ self.normal
        return residuals

    @property
    def rms_m(self) -> float:
        """Root mean square distance of the points from the line."""
        return float(np.sqrt(np.mean(self.residuals_m**2)))

    @property
    def length_m(self) -> float:
        """Distance between the ends."""
        return float(math.dist(self.start_m, self.end_m))


def fit_line(points_m: FloatArray, *, y_on_x: bool = False) -> FittedLine:
    """The best line through points (N, 2), N >= 1, from the projection of the first to the last.

    Points that all coincide give a line along +x, of length 0.
    """
    w = np.ones(len(points_m))
    centre = w @ points_m / w.sum()
    d = points_m - centre
    xx, xy, yy = w @ d[:, 0] ** 2, w @ (d[:, 0] * d[:, 1]), w @ d[:, 1] ** 2
    if not y_on_x:
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    elif xx <= 1e-12 * (xx + yy):
        angle = math.pi / 2 if yy > 0 else 0.0
    else:
        angle = math.atan2(xy, xx)
    along = np.array([math.cos(angle), math.sin(angle)])
    t = d @ along
    if t[-1] < t[0]:
        along, t = -along, -t
    return FittedLine(points_m, centre, along, centre + t[0] * along, centre + t[-1] * along)


def segment_of(
    line: FittedLine,
    *,
    layer: str,
    source: str,
    border: int | None,
    variances_m2: FloatArray,
) -> Segment:
    """A fitted line as the artifact, with rho >= 0 and the covariance of (rho, alpha).

    ``variances_m2`` (N,) are those of the points across the line.
    """
    rho, alpha, normal = normal_form(line)
    covariance = covariance_of(line.points_m, normal, variances_m2)
    read_only(covariance)
    return Segment(
        layer=layer,
        source=source,
        border=border,
        start_m=place_of(line.start_m),
        end_m=place_of(line.end_m),
        rho_m=rho,
        alpha_rad=alpha,
        covariance=covariance,
        rms_m=line.rms_m,
        points=len(line.points_m),
    )


def normal_form(line: FittedLine) -> tuple[float, float, FloatArray]:
    """rho >= 0 in metres, alpha in [-pi, pi) and the unit normal (2,) of a line."""
    normal = line.normal
    rho = float(normal @ line.centre_m)
    if rho < 0.0:
        rho, normal = -rho, -normal
    return rho, wrap_angle(math.atan2(normal[1], normal[0])), normal


def covariance_of(
    points_m: FloatArray,
    normal: FloatArray,
    variances_m2: FloatArray,
    weights: FloatArray | None = None,
) -> FloatArray:
    """(2, 2) covariance of (rho, alpha) of a least-squares line through points (N, 2).

    ``variances_m2`` (N,) are those of the points across the line; they need not be equal.
    ``weights`` (N,) are those of the fit, by default all the same.
    """
    w = np.full(len(points_m), 1.0 / len(points_m)) if weights is None else weights / weights.sum()
    t = points_m @ np.array([-normal[1], normal[0]])
    middle = float(w @ t)
    tau = t - middle
    spread = float(w @ tau**2)
    if spread <= 0.0:
        mean = float(w @ variances_m2)
        return np.diag([mean, math.pi**2 / 3.0])  # any direction will do
    of_alpha = float((w * tau) ** 2 @ variances_m2) / spread**2
    of_mean = float(w**2 @ variances_m2)
    both = -float(w**2 * tau @ variances_m2) / spread
    of_rho = of_mean + middle**2 * of_alpha + 2.0 * middle * both
    return np.array([[of_rho, both + middle * of_alpha], [both + middle * of_alpha, of_alpha]])


def variances_from_residuals(line: FittedLine, least_m: float) -> FloatArray:
    """Variance of each point across the line (N,), equal for all, from how far they lie from it.

    The sum of squares goes over n - 4: what is known of a line whose noise is estimated follows
    Student's t with n - 2 degrees of freedom, whose variance is larger by (n - 2) / (n - 4). With
    4 points or fewer nothing can be estimated; ``least_m`` is then taken, and is the least always.
    """
    n = len(line.points_m)
    found = float(line.residuals_m @ line.residuals_m) / (n - 4) if n > 4 else 0.0
    return np.full(n, max(found, least_m**2))


def variances_from_beams(
    line: FittedLine, origin_m: FloatArray, range_sigma_m: float | None
) -> FloatArray:
    """Variance of each point across the line (N,) when the noise is along beams from one origin.

    A beam that meets the line at an angle carries only the cosine of its noise across it.
    ``range_sigma_m`` None: estimated from the residuals, as above.
    """
    beams = line.points_m - origin_m
    lengths = np.maximum(np.hypot(beams[:, 0], beams[:, 1]), 1e-12)
    share = np.maximum((beams @ line.normal / lengths) ** 2, 1e-6)
    n = len(share)
    if range_sigma_m is not None:
        return range_sigma_m**2 * share
    if n <= 4:
        return np.maximum(variances_from_residuals(line, 1e-3), 1e-6)
    found = float(line.residuals_m @ line.residuals_m) / float(share.sum()) * n / (n - 4)
    return max(found, 1e-12) * share
