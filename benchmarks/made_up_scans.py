"""Rooms with known walls, what a lidar in them would measure, and how well lines fit the walls.

Rectangles, L and T shapes and polygons of 5 to 7 corners, turned by any angle, with 0 to 2 boxes.
The sides of the boxes set how well angles can be known at all, for a short wall has few points:
the *bound* (Cramer and Rao) is the least standard deviation that any unbiased way to find a wall's
direction can have, even one that is told which beams hit it. So scores carry it.
A wall counts as visible where at least 8 neighbouring beams of 360 hit it over at least 0.3 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

FloatArray = NDArray[np.float64]

MIN_BEAMS = 8
MIN_LENGTH_M = 0.3
MATCH_ANGLE_RAD = math.radians(5.0)
MATCH_OFFSET_M = 0.05
MATCH_OVERLAP = 0.5
BOX_M = (0.6, 1.4)  # least and greatest side
BOXES_M = {"small": (0.3, 0.9), "middle": BOX_M, "large": (1.0, 2.0)}


@dataclass(frozen=True, slots=True)
class MadeUpScan:
    """``ranges_m`` and ``bearings_rad`` (N,) from the origin, and the walls' visible pieces.

    ``pieces_m`` (K, 2, 2) are ends, x and y; ``countable`` (K,) are long enough to be asked for;
    ``bounds_rad`` (K,) the least standard deviation with which their directions can be known.
    """

    ranges_m: FloatArray
    bearings_rad: FloatArray
    pieces_m: FloatArray
    countable: NDArray[np.bool_]
    bounds_rad: FloatArray

    @property
    def points_m(self) -> FloatArray:
        """The returns (N, 2) as x, y around the sensor."""
        r, b = self.ranges_m, self.bearings_rad
        return np.column_stack([r * np.cos(b), r * np.sin(b)])


@dataclass(slots=True)
class Score:
    """Sums over many scans; the shares and errors are properties."""

    asked: int = 0
    found: int = 0
    predicted: int = 0
    right: int = 0
    scans: int = 0
    exact: int = 0
    angles_rad: list[float] | None = None
    ends_m: list[float] | None = None
    bounds_rad: list[float] | None = None

    def __post_init__(self) -> None:
        self.angles_rad, self.ends_m, self.bounds_rad = [], [], []

    @property
    def recall(self) -> float:
        """Visible pieces that have a line of their own."""
        return self.found / max(self.asked, 1)

    @property
    def precision(self) -> float:
        """Lines that are a visible piece."""
        return self.right / max(self.predicted, 1)

    @property
    def angle_rms_deg(self) -> float:
        """Root mean square error of direction over the matched pieces."""
        return math.degrees(math.sqrt(float(np.mean(np.square(self.angles_rad or [math.nan])))))

    @property
    def angle_bound_deg(self) -> float:
        """The least that :attr:`angle_rms_deg` can be expected to be, for the same pieces."""
        return math.degrees(math.sqrt(float(np.mean(np.square(self.bounds_rad or [math.nan])))))

    @property
    def end_median_m(self) -> float:
        """Median over the matched pieces of the mean distance of the two ends."""
        return float(np.median(self.ends_m or [math.nan]))

    def row(self, name: str) -> str:
        """One line of the table."""
        return (
            f"{name:<18}{100 * self.recall:8.1f}{100 * self.precision:13.1f}"
            f"{100 * self.exact / max(self.scans, 1):9.0f}{self.angle_rms_deg:11.3f}"
            f"{self.angle_bound_deg:8.3f}"
            f"{100 * self.end_median_m:9.2f}"
        )


HEADER = (
    f"{'method':<18}{'recall %':>8}{'precision %':>13}{'exact %':>9}"
    f"{'angle deg':>11}{'bound':>8}{'ends cm':>9}"
)


def made_up_scan(
    rng: np.random.Generator,
    *,
    sigma_m: float = 0.01,
    beams: int = 360,
    box_m: tuple[float, float] = BOX_M,
) -> MadeUpScan:
    """A scan from somewhere inside a made-up room, with noise on the ranges."""
    while True:
        walls = _walls(rng, box_m)
        inside = _polygon_contains(walls[0])
        low, high = walls[0].min(axis=0), walls[0].max(axis=0)
        for _ in range(50):
            eye = rng.uniform(low, high)
            free = inside(eye) and not any(_polygon_contains(box)(eye) for box in walls[1:])
            if free and min(_distance_to(polygon, eye) for polygon in walls) > 0.3:
                return _scan_from(rng, [polygon - eye for polygon in walls], sigma_m, beams)


def single_wall_scan(
    rng: np.random.Generator, *, sigma_m: float = 0.01
) -> tuple[FloatArray, FloatArray, float, float]:
    """A noisy scan of one straight wall: ranges, bearings, and the true rho and alpha."""
    rho, alpha = rng.uniform(0.5, 4.0), rng.uniform(-math.pi, math.pi)
    low = rng.uniform(-1.1, 0.3)
    step = math.radians(1.0)
    turn = low + step * np.arange(rng.integers(40, 90))
    turn = turn[turn < 1.15]
    ranges = rho / np.cos(turn) + rng.normal(0.0, sigma_m, turn.size)
    return ranges, turn + alpha, rho, alpha


def _walls(rng: np.random.Generator, box_m: tuple[float, float]) -> list[FloatArray]:
    """Corners of the room, then of each box, counter-clockwise."""
    w, h = rng.uniform(3.0, 8.0), rng.uniform(3.0, 6.0)
    kind = rng.choice(["rectangle", "L", "T", "polygon"])
    if kind == "rectangle":
        room = np.array([(0, 0), (w, 0), (w, h), (0, h)], float)
    elif kind == "L":
        a, b = w * rng.uniform(0.35, 0.65), h * rng.uniform(0.35, 0.65)
        room = np.array([(0, 0), (w, 0), (w, b), (a, b), (a, h), (0, h)], float)
    elif kind == "T":
        a, b = w * rng.uniform(0.2, 0.35), w * rng.uniform(0.65, 0.8)
        c = h * rng.uniform(0.35, 0.65)
        room = np.array([(0, c), (a, c), (a, 0), (b, 0), (b, c), (w, c), (w, h), (0, h)], float)
    else:
        corners = int(rng.integers(5, 8))
        angles = 2 * math.pi * (np.arange(corners) + rng.uniform(-0.25, 0.25, corners)) / corners
        radius = rng.uniform(2.0, 4.0, corners)
        room = np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])
    inside = _polygon_contains(room)
    polygons = [room]
    for _ in range(int(rng.integers(0, 3))):
        centre = rng.uniform(room.min(axis=0), room.max(axis=0))
        box = centre + _turned(_rectangle(*rng.uniform(*box_m, 2)), rng.uniform(0, math.pi))
        if all(inside(p) for p in box) and _distance_to(room, centre) > 0.9:
            polygons.append(box)
    turn = rng.uniform(-math.pi, math.pi)
    return [_turned(polygon, turn) for polygon in polygons]


def _rectangle(w: float, h: float) -> FloatArray:
    return np.array([(-w, -h), (w, -h), (w, h), (-w, h)]) / 2.0


def _turned(points: FloatArray, angle_rad: float) -> FloatArray:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return points @ np.array([[c, s], [-s, c]])


def _polygon_contains(polygon: FloatArray):  # type: ignore[no-untyped-def]
    nxt = np.roll(polygon, -1, axis=0)

    def contains(p: FloatArray) -> bool:
        above = (polygon[:, 1] > p[1]) != (nxt[:, 1] > p[1])
        dy = np.where(above, nxt[:, 1] - polygon[:, 1], 1.0)
        x = polygon[:, 0] + (p[1] - polygon[:, 1]) / dy * (nxt[:, 0] - polygon[:, 0])
        return bool((above & (x > p[0])).sum() % 2)

    return contains


def _distance_to(polygon: FloatArray, p: FloatArray) -> float:
    a, d = polygon, np.roll(polygon, -1, axis=0) - polygon
    t = np.clip(((p - a) * d).sum(1) / (d * d).sum(1), 0.0, 1.0)
    return float(np.hypot(*(a + t[:, None] * d - p).T).min())


def _scan_from(
    rng: np.random.Generator, polygons: list[FloatArray], sigma_m: float, beams: int
) -> MadeUpScan:
    a = np.concatenate(polygons)
    b = np.concatenate([np.roll(polygon, -1, axis=0) for polygon in polygons])
    bearings = -math.pi + 2 * math.pi * np.arange(beams) / beams
    ray = np.column_stack([np.cos(bearings), np.sin(bearings)])
    d = b - a
    cross = ray[:, :1] * d[:, 1] - ray[:, 1:] * d[:, 0]  # (beams, walls)
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]) / cross
        t = (a[:, 0] * ray[:, 1:] - a[:, 1] * ray[:, :1]) / cross
    r = np.where((t >= 0) & (t <= 1) & (r > 0), r, np.inf)
    wall = r.argmin(axis=1)
    true = r[np.arange(beams), wall]
    pieces, countable, runs = _visible_pieces(a, b, wall, true[:, None] * ray)
    bounds = [angle_bound_rad((true[:, None] * ray)[run], d[wall[run[0]]], sigma_m) for run in runs]
    noisy = true + rng.normal(0.0, sigma_m, beams)
    return MadeUpScan(noisy, bearings, pieces, countable, np.array(bounds))


def angle_bound_rad(hit_m: FloatArray, along_m: FloatArray, sigma_m: float) -> float:
    """The Cramer-Rao bound on the direction of a wall (radians), from where beams from the origin
    hit it (N, 2) and the noise along them. With n points spread evenly over a length L at noise s
    across the wall it is s sqrt(12 / n) / L.
    """
    along = along_m / np.hypot(*along_m)
    normal = np.array([-along[1], along[0]])
    cosine = hit_m @ normal / np.hypot(hit_m[:, 0], hit_m[:, 1])
    weight = 1.0 / np.maximum((sigma_m * cosine) ** 2, 1e-18)
    t = hit_m @ along
    spread = float(weight @ (t - weight @ t / weight.sum()) ** 2)
    return 1.0 / math.sqrt(spread) if spread > 0.0 else math.inf


def _visible_pieces(
    a: FloatArray, b: FloatArray, wall: NDArray[np.int64], hit: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], list[NDArray[np.int64]]]:
    """Runs of beams on one wall; it ends at the corner when the next beam hits its neighbour."""
    n = wall.size
    start = int(np.flatnonzero(wall != np.roll(wall, 1))[0])
    order = (start + np.arange(n)) % n
    cuts = np.flatnonzero(np.diff(wall[order])) + 1
    runs = np.split(order, cuts)
    pieces, countable = [], []
    for k, run in enumerate(runs):
        ends = []
        for beam, other in ((run[0], runs[k - 1][-1]), (run[-1], runs[(k + 1) % len(runs)][0])):
            mine, theirs = wall[beam], wall[other]
            shared = [
                p
                for p in (a[mine], b[mine])
                if min(np.hypot(*(p - a[theirs])), np.hypot(*(p - b[theirs]))) < 1e-9
                and np.hypot(*(p - hit[beam])) < 1.0
            ]
            ends.append(
                min(shared, key=lambda p: np.hypot(*(p - hit[beam]))) if shared else hit[beam]
            )
        pieces.append(ends)
        countable.append(run.size >= MIN_BEAMS and math.dist(ends[0], ends[1]) >= MIN_LENGTH_M)
    return np.array(pieces), np.array(countable), runs


def score_lines(score: Score, scan: MadeUpScan, lines_m: FloatArray) -> None:
    """Add one scan's lines (L, 2, 2): matched one to one by angle, offset and overlap."""
    score.scans += 1
    score.asked += int(scan.countable.sum())
    fits, ends, angles = _compare(scan.pieces_m, lines_m)
    rows, cols = linear_sum_assignment(np.where(fits, ends, 1e6))
    matched = fits[rows, cols]
    rows, cols = rows[matched], cols[matched]
    good = scan.countable[rows]
    score.found += int(good.sum())
    score.right += int(good.sum())
    score.predicted += len(lines_m) - int((~good).sum())
    score.exact += int(good.sum() == scan.countable.sum() and matched.sum() == len(lines_m))
    assert score.angles_rad is not None
    assert score.ends_m is not None
    assert score.bounds_rad is not None
    score.bounds_rad += scan.bounds_rad[rows][good].tolist()
    score.angles_rad += angles[rows, cols][good].tolist()
    score.ends_m += ends[rows, cols][good].tolist()


def _compare(
    pieces: FloatArray, lines: FloatArray
) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
    fits = np.zeros((len(pieces), len(lines)), bool)
    ends, angles = np.full(fits.shape, 1e6), np.zeros(fits.shape)
    for i, (p0, p1) in enumerate(pieces):
        along = p1 - p0
        length = float(np.hypot(*along))
        if length == 0.0:
            continue
        along = along / length
        for j, (q0, q1) in enumerate(lines):
            d = q1 - q0
            angle = math.atan2(along[0] * d[1] - along[1] * d[0], float(along @ d))
            angle = (angle + math.pi / 2) % math.pi - math.pi / 2
            middle = (q0 + q1) / 2 - p0
            offset = abs(along[0] * middle[1] - along[1] * middle[0])
            t = sorted((float((q0 - p0) @ along), float((q1 - p0) @ along)))
            shared = min(t[1], length) - max(t[0], 0.0)
            union = max(t[1], length) - min(t[0], 0.0)
            angles[i, j] = angle
            ends[i, j] = (
                min(math.dist(p0, q0) + math.dist(p1, q1), math.dist(p0, q1) + math.dist(p1, q0))
                / 2
            )
            fits[i, j] = (
                abs(angle) < MATCH_ANGLE_RAD
                and offset < MATCH_OFFSET_M
                and shared / union >= MATCH_OVERLAP
            )
    return fits, ends, angles
