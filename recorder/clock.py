"""Two clocks: the host's, which never steps, and a device's, brought into the host's time.

A line reaches the host some milliseconds after its measurement, and never before it. The device
stamped the measurement with its own clock, which has another origin and drifts. Arrival minus
device time is therefore the clocks' offset plus a delay, and the least delay of the last seconds
shows the offset best. What stays hidden is the part of the delay that every line has.
"""

from __future__ import annotations

import itertools
import time
import typing
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

NS_PER_MS = 1_000_000
NS_PER_S = 1_000_000_000
DEVICE_MS_BITS = 32

_OFFSET_WINDOW_NS = 10 * NS_PER_S
_DRIFT_WINDOW_NS = 60 * NS_PER_S
_DRIFT_MIN_SPAN_NS = 5 * NS_PER_S
_BUCKET_NS = NS_PER_S
_MAX_DRIFT = 0.02  # a bare RC oscillator is off by 1 %
_MAX_STEP_BACK_MS = 250  # reports may overtake each other by this much; more is a restart
_IN_STEP_MS = 500  # delays make the steps of both clocks differ by less than this
_AT_ONCE_MS = 1000  # times of one arrival that are so far apart are no delay of one line
_IN_STEP_AGAIN_MS = 2000
_TICKS_MS = (1000, 100)  # of a clock that is coarse
_STOOD_STILL_NS = 20 * NS_PER_MS
_MAX_STEP_AHEAD_MS = 60_000  # a device clock cannot run ahead of the host's by more than this


class Clock(typing.Protocol):
    """Anything that has the time in UNIX nanoseconds and never goes back."""

    def now_ns(self) -> int:
        """UNIX time, nanoseconds."""


class HostClock:
    """UNIX time read once, then carried on by the monotonic clock: setting the clock moves nothing.

    Both sources can be given, each a function that returns nanoseconds.
    """

    def __init__(
        self,
        wall_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._monotonic_ns = monotonic_ns
        self._unix_minus_monotonic_ns = wall_ns() - monotonic_ns()

    def now_ns(self) -> int:
        """UNIX time, nanoseconds."""
        return self._unix_minus_monotonic_ns + self._monotonic_ns()


@dataclass(frozen=True, slots=True)
class Estimate:
    """When a report was measured, in host time, and what the device's clock did before it.

    ``restarted``: it began anew. ``in_step_ms``: for so long, since the report before, it went on
    as the host's clock did; 0 when it did not.
    """

    t_ns: int
    restarted: bool
    in_step_ms: int
    by_arrival: bool = False  # the device's clock is coarser than the arrivals
    ahead: bool = False  # the device's times run ahead of the arrivals, and are taken


@dataclass(frozen=True, slots=True)
class _LeastDelay:
    """The report of one second that came with the least delay."""

    device_ns: int
    offset_ns: int


class DeviceClock:
    """Brings 32-bit device milliseconds into host time by the least delay of the last 10 s.

    The drift between the clocks is taken from the last minute, so that the old minima of a window
    can be carried forward to now. Memory and work per report are bounded.
    """

    def __init__(self) -> None:
        self._least: deque[_LeastDelay] = deque()
        self._device_ms: int | None = None  # unwrapped
        self._arrival_ns = 0
        self._drift = 0.0  # seconds by which the offset grows in a device second
        self._held_ns: int | None = None  # the offset, while the arrivals deny the device's times
        self._in_step_ms = 0
        self._ticks = _Ticks()

    @property
    def drift(self) -> float:
        """How much slower than the host's the device's clock runs (120e-6: 120 ppm)."""
        return self._drift

    def estimate(self, device_ms: int, arrival_ns: int) -> Estimate:
        """Host time of the measurement stamped ``device_ms``: never later than its arrival."""
        elapsed_ms = (arrival_ns - self._arrival_ns) / NS_PER_MS
        restarted, in_step_ms = self._advance(device_ms, arrival_ns)
        assert self._device_ms is not None
        device_ns = self._device_ms * NS_PER_MS
        offset_ns = arrival_ns - device_ns
        coarse = self._ticks.are_coarse(self._device_ms, arrival_ns, anew=restarted)
        if self._held_ns is not None:
            self._in_step_ms += in_step_ms if 2.0 * elapsed_ms > in_step_ms else 0
            if self._in_step_ms < _IN_STEP_AGAIN_MS:
                return Estimate(device_ns + self._held_ns, restarted, in_step_ms, ahead=True)
            self.forget()
        if coarse:
            return Estimate(arrival_ns, restarted, in_step_ms, by_arrival=True)
        self._remember(_LeastDelay(device_ns, offset_ns))
        newest_ns = self._least[-1].device_ns
        for least in reversed(self._least):
            if newest_ns - least.device_ns > _OFFSET_WINDOW_NS:
                break
            carried_ns = least.offset_ns + round(self._drift * (device_ns - least.device_ns))
            offset_ns = min(offset_ns, carried_ns)
        return Estimate(device_ns + offset_ns, restarted, in_step_ms)

    def forget(self) -> None:
        """The link went away: the device may come back with its clock set anew."""
        self._least.clear()
        self._held_ns, self._in_step_ms = None, 0

    def look_ahead(self, times_ms: Sequence[int], arrival_ns: int) -> None:
        """What is estimated next, all of one arrival.

        Times over a second apart that came at once (what had waited in a buffer, a file) were
        measured as far apart as they are: the last of the first such lot has come without delay,
        and all that follow as fast keep to that.
        """
        if len(times_ms) < 2 or self._held_ns is not None:
            return
        steps = [_signed(b - a, DEVICE_MS_BITS) for a, b in itertools.pairwise(times_ms)]
        if min(steps) < 0 or max(steps) > _MAX_STEP_AHEAD_MS or sum(steps) < _AT_ONCE_MS:
            return
        before_ms, first_ms = self._device_ms, times_ms[0]
        if before_ms is not None:
            first_ms = before_ms + _signed(first_ms - before_ms, DEVICE_MS_BITS)
            since_ms = first_ms + sum(steps) - before_ms
            elapsed_ms = (arrival_ns - self._arrival_ns) / NS_PER_MS
            if self._least and since_ms - elapsed_ms < _AT_ONCE_MS:
                return  # the link stood still meanwhile: the least delay will do
        offset_ns = arrival_ns - (first_ms + sum(steps)) * NS_PER_MS
        self._held_ns = self._least[-1].offset_ns if self._least else offset_ns

    def _advance(self, device_ms: int, arrival_ns: int) -> tuple[bool, int]:
        """Unwrap ``device_ms``; whether the clock began anew, and how long it was in step."""
        previous_ms, elapsed_ms = self._device_ms, (arrival_ns - self._arrival_ns) / NS_PER_MS
        self._arrival_ns = arrival_ns
        if previous_ms is None:
            self._device_ms = device_ms
            return False, 0
        step_ms = _signed(device_ms - previous_ms, DEVICE_MS_BITS)
        ahead_ms = step_ms - elapsed_ms
        if step_ms < -_MAX_STEP_BACK_MS or ahead_ms > _MAX_STEP_AHEAD_MS:
            self._device_ms = device_ms
            self.forget()
            return True, 0
        self._device_ms = previous_ms + step_ms
        in_step = abs(ahead_ms) <= _IN_STEP_MS + _MAX_DRIFT * elapsed_ms
        return False, max(step_ms, 0) if in_step else 0

    def _remember(self, new: _LeastDelay) -> None:
        """Keep one report a second, the least delayed, for as long as the drift needs them."""
        second = new.device_ns // _BUCKET_NS
        newest = self._least[-1].device_ns // _BUCKET_NS if self._least else second - 1
        if second <= newest:
            if second == newest and new.offset_ns < self._least[-1].offset_ns:
                self._least[-1] = new
            return
        self._drift = _drift_of(self._least, self._drift)
        self._least.append(new)
        while new.device_ns - self._least[0].device_ns > _DRIFT_WINDOW_NS:
            self._least.popleft()


class _Ticks:
    """Whether a device's clock goes by so coarse ticks that the arrivals are the better times."""

    def __init__(self) -> None:
        self._first_ms: int | None = None
        self._tick_ms = 0
        self._before = (0, 0)  # the last device time, and when a line of it came first
        self._stood_still = False

    def are_coarse(self, device_ms: int, arrival_ns: int, *, anew: bool) -> bool:
        """With one more time: all are whole ticks apart, and one lasted while lines came."""
        if self._first_ms is None or anew:
            self._first_ms, self._tick_ms, self._stood_still = device_ms, _TICKS_MS[0], False
            self._before = (device_ms, arrival_ns)
            return False
        while self._tick_ms and (device_ms - self._first_ms) % self._tick_ms:
            finer = [tick for tick in _TICKS_MS if tick < self._tick_ms]
            self._tick_ms = finer[0] if finer else 0
        if device_ms != self._before[0]:
            self._before = (device_ms, arrival_ns)
        elif arrival_ns - self._before[1] > _STOOD_STILL_NS:
            self._stood_still = True
        return self._tick_ms > 0 and self._stood_still


def _signed(value: int, bits: int) -> int:
    """``value`` modulo 2**bits, in [-2**(bits - 1), 2**(bits - 1))."""
    half = 1 << (bits - 1)
    return (value + half) % (1 << bits) - half


def _drift_of(points: Sequence[_LeastDelay], otherwise: float) -> float:
    """Slope of the line below all points that leaves the least delay in all.

    That line carries the edge of the lower convex hull over the mean device time (linear
    programming: Moon, Skelly and Towsley, INFOCOM 1999). ``otherwise`` while the points span little
    time; at most 2 % either way.
    """
    if len(points) < 2 or points[-1].device_ns - points[0].device_ns < _DRIFT_MIN_SPAN_NS:
        return otherwise
    hull: list[_LeastDelay] = []
    for point in points:
        while len(hull) >= 2 and _turns_right(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    mean_ns = sum(point.device_ns for point in points) / len(points)
    right = next(i for i in range(1, len(hull)) if hull[i].device_ns >= mean_ns)
    a, b = hull[right - 1], hull[right]
    slope = (b.offset_ns - a.offset_ns) / (b.device_ns - a.device_ns)
    return min(max(slope, -_MAX_DRIFT), _MAX_DRIFT)


def _turns_right(a: _LeastDelay, b: _LeastDelay, c: _LeastDelay) -> bool:
    """Whether b lies on or above the line from a to c, so that it is not on the lower hull."""
    ab = (b.offset_ns - a.offset_ns) * (c.device_ns - a.device_ns)
    ac = (c.offset_ns - a.offset_ns) * (b.device_ns - a.device_ns)
    return ab >= ac
