"""Wheel counts → poses: arcs, counters that run over, laws of dead reckoning."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.geometry import IDENTITY, SE2, wrap_angle
from recorder.odometry import DeadReckoning, WheelGeometry, arc, count_change

TRACK_M = 0.106
rolled_m = st.floats(-2.0, 2.0)
counts = st.integers(0, 65535)


def assert_close(a: SE2, b: SE2, tolerance: float = 1e-9) -> None:
    assert math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) < tolerance
    assert abs(wrap_angle(a.heading_rad - b.heading_rad)) < tolerance


def test_straight_turn_and_quarter_circle():
    assert_close(arc(0.5, 0.5, TRACK_M), SE2(0.5, 0.0, 0.0))
    quarter = math.pi / 2
    assert_close(arc(-quarter * 0.05, quarter * 0.05, 0.1), SE2(0.0, 0.0, quarter))
    # The middle on a circle of 1 m to the left: the wheels on circles of 0.95 and 1.05 m.
    assert_close(arc(quarter * 0.95, quarter * 1.05, 0.1), SE2(1.0, 1.0, quarter))


@given(rolled_m, rolled_m)
@settings(deadline=None)
def test_an_arc_is_the_limit_of_many_small_straight_steps(left_m, right_m):
    steps = 2000
    here = IDENTITY
    turn_rad = (right_m - left_m) / TRACK_M / steps
    for _ in range(steps):
        here = here @ SE2(0.0, 0.0, turn_rad / 2)
        here = here @ SE2((left_m + right_m) / 2 / steps, 0.0, 0.0)
        here = here @ SE2(0.0, 0.0, turn_rad / 2)
    assert_close(here, arc(left_m, right_m, TRACK_M), 1e-3)


@given(rolled_m, rolled_m, st.floats(0.0, 1.0))
@settings(deadline=None)
def test_two_parts_of_an_arc_make_the_whole(left_m, right_m, share):
    first = arc(share * left_m, share * right_m, TRACK_M)
    rest = arc((1 - share) * left_m, (1 - share) * right_m, TRACK_M)
    assert_close(first @ rest, arc(left_m, right_m, TRACK_M))


@given(rolled_m, rolled_m)
@settings(deadline=None)
def test_rolling_back_undoes_an_arc(left_m, right_m):
    assert_close(arc(left_m, right_m, TRACK_M) @ arc(-left_m, -right_m, TRACK_M), IDENTITY)


@given(st.floats(-1.0, 1.0), st.floats(-1e-8, 1e-8))
@settings(deadline=None)
def test_nearly_straight_is_nearly_straight(middle_m, difference_m):
    end = arc(middle_m - difference_m, middle_m + difference_m, TRACK_M)
    assert_close(end, SE2(middle_m, 0.0, 0.0), 1e-6)


@given(counts, st.integers(-32768, 32767))
@settings(deadline=None)
def test_a_counter_may_run_over(before, moved):
    assert count_change(before, (before + moved) % 65536) == moved
    assert count_change(before - 65536, before + moved) == moved


@given(st.lists(st.tuples(*[st.integers(-3000, 3000)] * 2), min_size=1, max_size=40), counts)
@settings(deadline=None)
def test_where_the_counters_began_makes_no_difference(moves, offset):
    geometry = WheelGeometry(ticks_per_m=2000.0, track_m=TRACK_M)
    plain, wrapped = DeadReckoning(geometry), DeadReckoning(geometry)
    assert plain.update(0, 0) == IDENTITY
    assert wrapped.update(offset, offset) == IDENTITY
    sums = itertools.accumulate(moves, lambda a, b: (a[0] + b[0], a[1] + b[1]))
    for left, right in sums:
        here = plain.update(left, right)
        assert wrapped.update((left + offset) % 65536, (right + offset) % 65536) == here


def test_a_restarted_device_does_not_jump():
    dead_reckoning = DeadReckoning(WheelGeometry(ticks_per_m=1000.0, track_m=TRACK_M))
    dead_reckoning.update(20_000, 20_000)
    here = dead_reckoning.update(21_000, 21_000)
    assert_close(here, SE2(1.0, 0.0, 0.0))
    dead_reckoning.restart()
    assert dead_reckoning.update(0, 0) == here
    assert_close(dead_reckoning.update(500, 500), SE2(1.5, 0.0, 0.0))


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_wheels_need_sizes(bad):
    with pytest.raises(ValueError, match="must be above zero"):
        WheelGeometry(bad, 0.1)
    with pytest.raises(ValueError, match="must be above zero"):
        WheelGeometry(1000.0, bad)
