"""Ordered points to lines: cut into pieces, merge, settle the joints, fit, intersect.

A *chain* is an ordered run of points; many go through one call, ``offsets`` (C + 1,) marking where
each starts in ``xy`` (N, 2). A *piece* is a run of its points, ``first`` and ``count``; in a closed
chain it may run over the end. ``sums`` (pieces, 6) hold, relative to the chain's first point so
that no digits are lost, n, x, y, xx, xy and yy: two pieces merge by adding them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping.line_kernels import layout

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(cache=True)
def _across(n: float, x: float, y: float, xx: float, xy: float, yy: float, y_on_x: bool) -> float:
    """Sum of squared distances of the points with these sums from their own best line."""
    if n < 3.0:
        return 0.0
    xx -= x * x / n
    xy -= x * y / n
    yy -= y * y / n
    if y_on_x:
        if xx <= 1e-12 * (xx + yy):
            return max(xx, 0.0)
        return max((yy - xy * xy / xx) / (1.0 + (xy / xx) ** 2), 0.0)
    return max(0.5 * (xx + yy) - math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy), 0.0)


@njit(cache=True)
def _direction(s: Floats, y_on_x: bool) -> tuple[float, float]:
    """Unit vector along a piece's best line; (1, 0) where all its points coincide."""
    n, x, y = s[0], s[1], s[2]
    xx, xy, yy = s[3] - x * x / n, s[4] - x * y / n, s[5] - y * y / n
    if y_on_x:
        u, v = (xx, xy) if xx > 1e-12 * (xx + yy) else (0.0, yy)
        h = math.hypot(u, v)
        return (u / h, v / h) if h > 0.0 else (1.0, 0.0)
    h = math.hypot(xx - yy, 2.0 * xy)
    if h == 0.0:
        return 1.0, 0.0
    # Half of the angle atan2(2 xy, xx - yy), by the larger of its cosine and sine.
    larger = math.sqrt(0.5 + 0.5 * abs(xx - yy) / h)
    return (larger, xy / (h * larger)) if xx > yy else (xy / (h * larger), larger)


@njit(cache=True)
def _farthest(xy: Floats, low: int, high: int, closed: bool) -> tuple[int, float]:
    """The point strictly between two that lies farthest from their chord, and how far.

    Where there is no chord, or ``closed`` makes it meaningless: from the first of the two.
    """
    x0, y0 = xy[low, 0], xy[low, 1]
    dx, dy = xy[high, 0] - x0, xy[high, 1] - y0
    length = math.sqrt(dx * dx + dy * dy)
    at, most = low + 1, -1.0
    if length > 0.0 and not closed:
        for i in range(low + 1, high):
            d = abs(dx * (xy[i, 1] - y0) - dy * (xy[i, 0] - x0))
            if d > most:
                at, most = i, d
        return at, most / length
    for i in range(low + 1, high):
        d = (xy[i, 0] - x0) ** 2 + (xy[i, 1] - y0) ** 2
        if d > most:
            at, most = i, d
    return at, math.sqrt(max(most, 0.0))


@njit(cache=True)
def _split(
    xy: Floats, begin: int, end: int, closed: bool, epsilon: float, stack: Ints, first: Ints,
    log: Floats, logged: int,
) -> tuple[int, int]:  # fmt: skip
    """Cut at the farthest point from the chord until all lie within ``epsilon``.

    Fills ``first`` with where the pieces start, ``log`` with each split as low, high, cut, distance
    in the order in which they were made; returns how many there are of both.
    """
    pieces = top = 0
    stack[0, 0], stack[0, 1] = begin, end - 1
    forced = closed  # the chord of a closed chain means nothing: its farthest point is a corner
    while top >= 0:
        low, high = stack[top, 0], stack[top, 1]
        top -= 1
        if high - low >= 2:
            at, far = _farthest(xy, low, high, forced)
            forced = False
            if far > epsilon:
                log[logged, 0], log[logged, 1] = low, high
                log[logged, 2], log[logged, 3] = at, far
                logged += 1
                stack[top + 1, 0], stack[top + 1, 1] = at, high
                stack[top + 2, 0], stack[top + 2, 1] = low, at
                top += 2
                continue
        first[pieces] = low
        pieces += 1
    return pieces, logged


@njit(cache=True)
def _grow(
    xy: Floats,
    begin: int,
    end: int,
    rms: float,
    y_on_x: bool,
    first: Ints,
    log: Floats,
    logged: int,
) -> tuple[int, int]:
    """Take point after point while the fit's rms stays within the bound; the last set counts too.

    The new set starts with the last point of the old one, so that the two meet there.
    """
    pieces, first[0] = 1, begin
    n = sx = sy = sxx = sxy = syy = 0.0
    for i in range(begin, end):
        x, y = xy[i, 0] - xy[begin, 0], xy[i, 1] - xy[begin, 1]
        n += 1.0
        sx, sy, sxx, sxy, syy = sx + x, sy + y, sxx + x * x, sxy + x * y, syy + y * y
        square = _across(n, sx, sy, sxx, sxy, syy, y_on_x) / n
        if square > rms * rms:
            log[logged, 0], log[logged, 1] = first[pieces - 1], i
            log[logged, 2], log[logged, 3] = i - 1, math.sqrt(square)
            logged += 1
            first[pieces] = i - 1
            pieces += 1
            u, v = xy[i - 1, 0] - xy[begin, 0], xy[i - 1, 1] - xy[begin, 1]
            n, sx, sy = 2.0, x + u, y + v
            sxx, sxy, syy = x * x + u * u, x * y + u * v, y * y + v * v
    return pieces, logged


@njit(cache=True)
def _sum_up(
    xy: Floats, begin: int, end: int, first: Ints, count: Ints, sums: Floats, pieces: int
) -> None:
    for p in range(pieces):
        stop = first[p + 1] if p + 1 < pieces else end
        sx = sy = sxx = sxy = syy = 0.0
        for i in range(first[p], stop):
            x, y = xy[i, 0] - xy[begin, 0], xy[i, 1] - xy[begin, 1]
            sx, sy, sxx, sxy, syy = sx + x, sy + y, sxx + x * x, sxy + x * y, syy + y * y
        count[p] = stop - first[p]
        sums[p, 0], sums[p, 1], sums[p, 2] = stop - first[p], sx, sy
        sums[p, 3], sums[p, 4], sums[p, 5] = sxx, sxy, syy


@njit(cache=True)
def _joint_cost(
    xy: Floats, begin: int, end: int, first: Ints, count: Ints, sums: Floats, a: int, pieces: int,
    ring: bool, rule: int, limits: tuple[float, float, float], y_on_x: bool,
) -> float:  # fmt: skip
    """How little two neighbours look like one line, over the rule's limit; below 1 they do."""
    if pieces < 2 or (a + 1 == pieces and not ring):
        return math.inf
    b = (a + 1) % pieces
    last_a = begin + (first[a] - begin + count[a] - 1) % (end - begin)
    last_b = begin + (first[b] - begin + count[b] - 1) % (end - begin)
    ux, uy = xy[last_a, 0] - xy[first[a], 0], xy[last_a, 1] - xy[first[a], 1]
    vx, vy = xy[last_b, 0] - xy[first[b], 0], xy[last_b, 1] - xy[first[b], 1]
    if ux * vx + uy * vy < 0.0 and min(ux * ux + uy * uy, vx * vx + vy * vy) > 4.0 * limits[2] ** 2:
        return math.inf  # up one side of a thin wall and down the other
    if rule == layout.JOINT_FIT:
        s, t = sums[a], sums[b]
        n, x, y = s[0] + t[0], s[1] + t[1], s[2] + t[2]
        across = _across(n, x, y, s[3] + t[3], s[4] + t[4], s[5] + t[5], y_on_x)
        return float(math.sqrt(across / n) / limits[0])
    (ax, ay), (bx, by) = _direction(sums[a], y_on_x), _direction(sums[b], y_on_x)
    bent = abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
    bent = min(bent, math.pi - bent)
    if sums[a, 0] < 3.0 or sums[b, 0] < 3.0:
        bent = 0.0  # one or two points have no direction worth the name
    if rule == layout.ANGLE:
        return float(bent / limits[1])
    if rule == layout.COLLINEAR:  # each centre from the other's line
        x, y = sums[b, 1] / sums[b, 0], sums[b, 2] / sums[b, 0]
        u, v = sums[a, 1] / sums[a, 0], sums[a, 2] / sums[a, 0]
        off = max(_distance(sums[a], ax, ay, x, y), _distance(sums[b], bx, by, u, v))
        return float(off / limits[2])
    # The ends are close where both lines pass close to the point at which they meet.
    x, y = xy[first[b], 0] - xy[begin, 0], xy[first[b], 1] - xy[begin, 1]
    apart = _distance(sums[a], ax, ay, x, y) + _distance(sums[b], bx, by, x, y)
    return float(max(apart / limits[2], bent / limits[1]))


@njit(cache=True)
def _distance(s: Floats, dx: float, dy: float, x: float, y: float) -> float:
    """Of the place (x, y) from the line through a piece's centre along (dx, dy)."""
    return float(abs(dx * (y - s[2] / s[0]) - dy * (x - s[1] / s[0])))


@njit(cache=True)
def _merge(
    xy: Floats, begin: int, end: int, ring: bool, first: Ints, count: Ints, sums: Floats,
    pieces: int, cost: Floats, rule: int, limits: tuple[float, float, float], y_on_x: bool,
    log: Floats, logged: int,
) -> tuple[int, int]:  # fmt: skip
    """Neighbours that pass the test become one, the best pair first."""
    for p in range(pieces):
        cost[p] = _joint_cost(
            xy, begin, end, first, count, sums, p, pieces, ring, rule, limits, y_on_x
        )
    while pieces > 1:
        a = int(np.argmin(cost[:pieces]))
        if not cost[a] < 1.0:
            break
        b = (a + 1) % pieces
        log[logged, 0], log[logged, 1] = first[a], count[a] + count[b]
        log[logged, 2], log[logged, 3] = first[b], cost[a]
        logged += 1
        sums[a] += sums[b]
        count[a] += count[b]
        for p in range(b, pieces - 1):
            first[p], count[p], cost[p] = first[p + 1], count[p + 1], cost[p + 1]
            sums[p] = sums[p + 1]
        pieces -= 1
        a = a if b > 0 else a - 1
        for p in ((a - 1) % pieces, a):
            cost[p] = _joint_cost(
                xy, begin, end, first, count, sums, p, pieces, ring, rule, limits, y_on_x
            )
    return pieces, logged


@njit(cache=True)
def _settle(
    xy: Floats, begin: int, end: int, first: Ints, count: Ints, sums: Floats, a: int, b: int,
    reach: int, y_on_x: bool,
) -> None:  # fmt: skip
    """Put the joint of two neighbours where both together fit best, up to ``reach`` points off."""
    n, at = end - begin, first[b] - begin
    back, ahead = min(reach, count[a] - 2), min(reach, count[b] - 2)
    if back < 0 or ahead < 0:
        return
    s, t = sums[a], sums[b]
    least, best = _total(s, t, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, y_on_x) - 1e-12, 0
    moved = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for sign in (-1, 1):
        k = dx = dy = dxx = dxy = dyy = 0.0
        for step in range(1, (back if sign < 0 else ahead) + 1):
            i = begin + (at - step if sign < 0 else at + step - 1) % n
            x, y = xy[i, 0] - xy[begin, 0], xy[i, 1] - xy[begin, 1]
            k += sign
            dx, dy = dx + sign * x, dy + sign * y
            dxx, dxy, dyy = dxx + sign * x * x, dxy + sign * x * y, dyy + sign * y * y
            total = _total(s, t, k, dx, dy, dxx, dxy, dyy, y_on_x)
            if total < least:  # rounding moves nothing: an equally good joint stays where it is
                least, best = total, sign * step
                moved = (k, dx, dy, dxx, dxy, dyy)
    for j in range(6):
        s[j] += moved[j]
        t[j] -= moved[j]
    first[b] = begin + (at + best) % n
    count[a] += best
    count[b] -= best


@njit(cache=True)
def _total(
    s: Floats, t: Floats, n: float, x: float, y: float, xx: float, xy: float, yy: float,
    y_on_x: bool,
) -> float:  # fmt: skip
    """The squares of two pieces together when points with these sums change from ``t`` to ``s``."""
    one = _across(s[0] + n, s[1] + x, s[2] + y, s[3] + xx, s[4] + xy, s[5] + yy, y_on_x)
    other = _across(t[0] - n, t[1] - x, t[2] - y, t[3] - xx, t[4] - xy, t[5] - yy, y_on_x)
    return float(one + other)


@njit(cache=True)
def _fit(
    xy: Floats, begin: int, end: int, first: int, count: int, s: Floats, y_on_x: bool,
    line: Floats,
) -> None:  # fmt: skip
    """Fill ``line`` from a piece: normal form, spreads, and its outer points projected on it."""
    dx, dy = _direction(s, y_on_x)
    mx, my = s[1] / s[0], s[2] / s[0]
    last = begin + (first - begin + count - 1) % (end - begin)
    t0 = dx * (xy[first, 0] - xy[begin, 0] - mx) + dy * (xy[first, 1] - xy[begin, 1] - my)
    t1 = dx * (xy[last, 0] - xy[begin, 0] - mx) + dy * (xy[last, 1] - xy[begin, 1] - my)
    if t1 < t0:  # run as the points do
        dx, dy, t0, t1 = -dx, -dy, -t0, -t1
    xx, yy = s[3] - mx * s[1], s[5] - my * s[2]
    cross = s[4] - mx * s[2]
    line[layout.FIRST], line[layout.COUNT] = first, count
    line[layout.NORMAL_X], line[layout.NORMAL_Y] = -dy, dx
    line[layout.CENTRE_X], line[layout.CENTRE_Y] = mx + xy[begin, 0], my + xy[begin, 1]
    line[layout.ALONG] = max(dx * dx * xx + 2.0 * dx * dy * cross + dy * dy * yy, 0.0)
    line[layout.ACROSS] = max(dy * dy * xx - 2.0 * dx * dy * cross + dx * dx * yy, 0.0)
    x, y = line[layout.CENTRE_X], line[layout.CENTRE_Y]
    line[layout.X0], line[layout.Y0] = x + t0 * dx, y + t0 * dy
    line[layout.X1], line[layout.Y1] = x + t1 * dx, y + t1 * dy
    line[layout.CORNER0] = line[layout.CORNER1] = 0.0


@njit(cache=True)
def _corner(a: Floats, b: Floats, min_sine: float, reach: float) -> None:
    """Let two neighbouring lines meet where they cross, unless the crossing is far or shallow."""
    sine = a[layout.NORMAL_X] * b[layout.NORMAL_Y] - a[layout.NORMAL_Y] * b[layout.NORMAL_X]
    if abs(sine) < min_sine:
        return
    ra = a[layout.NORMAL_X] * a[layout.CENTRE_X] + a[layout.NORMAL_Y] * a[layout.CENTRE_Y]
    rb = b[layout.NORMAL_X] * b[layout.CENTRE_X] + b[layout.NORMAL_Y] * b[layout.CENTRE_Y]
    x = (ra * b[layout.NORMAL_Y] - rb * a[layout.NORMAL_Y]) / sine
    y = (rb * a[layout.NORMAL_X] - ra * b[layout.NORMAL_X]) / sine
    if math.hypot(x - a[layout.X1], y - a[layout.Y1]) > reach:
        return
    if math.hypot(x - b[layout.X0], y - b[layout.Y0]) > reach:
        return
    a[layout.X1], a[layout.Y1], a[layout.CORNER1] = x, y, 1.0
    b[layout.X0], b[layout.Y0], b[layout.CORNER0] = x, y, 1.0


@njit(cache=True)
def _lines_of_pieces(
    xy: Floats, begin: int, end: int, ring: bool, first: Ints, count: Ints, sums: Floats,
    pieces: int, settings: Floats, out: Floats, n_out: int,
) -> int:  # fmt: skip
    """Fit the pieces of a chain, let them meet, and leave out what is too short."""
    y_on_x, drop, min_points = settings[6] > 0.0, int(settings[8]) == layout.WRAP_DROP, settings[10]
    before = n_out
    for p in range(pieces):
        if count[p] >= min_points:
            _fit(xy, begin, end, first[p], count[p], sums[p], y_on_x, out[n_out])
            n_out += 1
    for p in range(before, n_out - 1):
        _corner(out[p], out[p + 1], settings[4], settings[5])
    if ring and n_out - before > 2:
        _corner(out[n_out - 1], out[before], settings[4], settings[5])
    kept = before
    for p in range(before, n_out):
        # The outer two have already set the corners of their neighbours.
        outer = out[p, layout.FIRST] == first[0] or out[p, layout.FIRST] == first[pieces - 1]
        dx, dy = out[p, layout.X1] - out[p, layout.X0], out[p, layout.Y1] - out[p, layout.Y0]
        if math.hypot(dx, dy) >= settings[3] and not (outer and drop):
            out[kept, :] = out[p, :]
            kept += 1
    return kept


@njit(cache=True)
def lines_of_chains(
    xy: Floats, offsets: Ints, closed: NDArray[np.bool_], method: int, given: Ints,
    settings: Floats, log: NDArray[np.float64], out: Floats,
) -> tuple[int, int, int]:  # fmt: skip
    """The lines of many chains: fills ``out`` (lines, columns of LINE), ``log[0]`` with the splits
    and ``log[1]`` with the merges (K, 4).

    ``given`` (cuts,) is where pieces start, for the method GIVEN; ``settings`` are in the order of
    SETTINGS. Returns how many lines, splits and merges there are.
    """
    epsilon, rms, merge_angle, y_on_x = settings[0], settings[1], settings[2], settings[6] > 0.0
    merge, wrap, settle = int(settings[7]), int(settings[8]), int(settings[9])
    most = 0
    for c in range(closed.size):
        most = max(most, offsets[c + 1] - offsets[c])
    whole, real = np.empty((4, most + 3), np.int64), np.empty((7, most + 3))
    stack, first, count = whole[:2].reshape((most + 3, 2)), whole[2], whole[3]
    sums, cost = real[:6].reshape((most + 3, 6)), real[6]
    n_out = n_split = n_merge = next_given = 0
    for c in range(closed.size):
        begin, end = offsets[c], offsets[c + 1]
        if end - begin < 2:
            continue
        if method == layout.SPLIT:
            pieces, n_split = _split(
                xy, begin, end, closed[c], epsilon, stack, first, log[0], n_split
            )
        elif method == layout.INCREMENTAL:
            pieces, n_split = _grow(xy, begin, end, rms, y_on_x, first, log[0], n_split)
        else:
            pieces = 0
            while next_given < given.size and given[next_given] < end:
                first[pieces] = given[next_given]
                pieces, next_given = pieces + 1, next_given + 1
        _sum_up(xy, begin, end, first, count, sums, pieces)
        ring = closed[c] and wrap == layout.WRAP_ON
        if merge != layout.NO_MERGE:
            pieces, n_merge = _merge(
                xy, begin, end, ring, first, count, sums, pieces, cost, merge,
                (rms, merge_angle, epsilon), y_on_x, log[1], n_merge,
            )  # fmt: skip
        for p in range(pieces if ring and pieces > 1 else pieces - 1):
            _settle(xy, begin, end, first, count, sums, p, (p + 1) % pieces, settle, y_on_x)
        until = _lines_of_pieces(
            xy, begin, end, ring, first, count, sums, pieces, settings, out, n_out
        )
        out[n_out:until, layout.CHAIN] = c
        n_out = until
    return n_out, n_split, n_merge
