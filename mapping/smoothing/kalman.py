"""A Kalman filter and Rauch-Tung-Striebel smoother of one coordinate over time.

The coordinate moves on at a speed that white noise changes (constant velocity: Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, chapter 6), or it
wanders itself where its motion is known otherwise and only the difference is left. Forth by Kalman
(1960), back by Rauch, Tung and Striebel (1965). Written out for two numbers a state, as matrices of
two rows take ten times as long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorder.columns import Floats

GATE = 5.0  # standard deviations of an innovation, beyond which a measurement is not believed
IN_A_ROW = 2  # so many not to be believed, and it is the state that is wrong: it starts anew


@dataclass(frozen=True, slots=True)
class Motion:
    """How a coordinate moves and is measured.

    ``noise`` is the variance of a measurement. ``drive`` is the spectral density of what changes
    the speed (unit² / s³), or if it ``wanders`` the coordinate itself (unit² / s). Differences are
    taken round a circle of ``turn`` (0: none). Who is off by less than ``least_jump`` never jumps.
    ``fastest`` is one standard deviation of a speed of which nothing is known yet.
    """

    noise: float
    drive: float
    wanders: bool = False
    turn: float = 0.0
    least_jump: float = 0.0
    fastest: float = 1.0


State = tuple[float, float, float, float, float]  # value, speed; variances: value, both, speed


@dataclass(frozen=True, slots=True)
class Filtered:
    """What the way forth comes to, N times: states before and after each measurement.

    ``begins`` are where a state starts anew, ``cost`` is the negative log-likelihood of the
    innovations; one that is not believed counts as one at the gate.
    """

    before: list[State]
    after: list[State]
    begins: NDArray[np.bool_]
    cost: float


def filtered(
    t_s: Floats, values: Floats, measured: NDArray[np.bool_], cut: NDArray[np.bool_], motion: Motion
) -> Filtered:
    """Go forth over times (N,), where ``measured`` with a value; ``cut`` (N,): start anew here."""
    count = len(t_s)
    before: list[State] = [(0.0,) * 5] * count
    after, begins = list(before), cut.copy()
    at, cost, refused, state = 0, 0.0, list[int](), before[0]
    times, z = t_s.tolist(), values.tolist()
    if count:
        begins[0] = True
    while at < count:
        if begins[at]:
            state = before[at] = after[at] = _fresh(z[at], motion)
            refused = []
            at += 1
            continue
        before[at] = state = _moved(state, times[at] - times[at - 1], motion)
        if measured[at]:
            off, variance = _round(z[at] - state[0], motion.turn), state[2] + motion.noise
            squared = off * off / variance
            if squared > GATE * GATE and abs(off) > motion.least_jump:
                cost += 0.5 * (GATE * GATE + math.log(variance))
                refused.append(at)
                if len(refused) == IN_A_ROW:
                    at = refused[0]
                    begins[at], refused = True, []
                    continue
            else:
                cost += 0.5 * (squared + math.log(variance))
                state, refused = _corrected(state, off, variance), []
        after[at] = state
        at += 1
    return Filtered(before, after, begins, cost)


def smoothed(t_s: Floats, way: Filtered, motion: Motion) -> Floats:
    """Go back: the value at each time (N,) by all measurements of its stretch."""
    count = len(t_s)
    out, times = [0.0] * count, t_s.tolist()
    state: tuple[float, float] = (0.0, 0.0)
    for at in range(count - 1, -1, -1):
        value, speed, p, c, s = way.after[at]
        if at == count - 1 or way.begins[at + 1]:
            state = (value, speed)
        else:
            dt = times[at + 1] - times[at]
            b_value, b_speed, bp, bc, bs = way.before[at + 1]
            d_value, d_speed = state[0] - b_value, state[1] - b_speed
            if motion.wanders:
                state = (value + p / bp * d_value, 0.0)
            elif (det := bp * bs - bc * bc) <= 0.0:  # so near in time that rounding is all
                state = (state[0], speed)
            else:
                # The gain is P Fᵀ B⁻¹, with P after this measurement and B before the next.
                low, high = (bs * d_value - bc * d_speed) / det, (bp * d_speed - bc * d_value) / det
                state = (
                    value + (p + c * dt) * low + c * high,
                    speed + (c + s * dt) * low + s * high,
                )
        out[at] = state[0]
    return np.array(out)


def _fresh(value: float, motion: Motion) -> State:
    return value, 0.0, motion.noise, 0.0, 0.0 if motion.wanders else motion.fastest**2


def _moved(state: State, dt: float, motion: Motion) -> State:
    value, speed, p, c, s = state
    q = motion.drive
    if motion.wanders:
        return value, 0.0, p + q * dt, 0.0, 0.0
    return (
        value + speed * dt, speed,
        p + dt * (2.0 * c + dt * s) + q * dt**3 / 3.0, c + dt * s + q * dt * dt / 2.0, s + q * dt,
    )  # fmt: skip


def _corrected(state: State, off: float, variance: float) -> State:
    value, speed, p, c, s = state
    k, m = p / variance, c / variance
    return value + k * off, speed + m * off, (1.0 - k) * p, (1.0 - k) * c, s - m * c


def _round(off: float, turn: float) -> float:
    return off - turn * math.floor(off / turn + 0.5) if turn else off
