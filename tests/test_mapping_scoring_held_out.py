"""The score without truth: its likelihood, its intervals, and that a better map scores better."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.config import load_config
from mapping.kernels.held_out import log_likelihoods
from mapping.pipeline import geometry_of
from mapping.placed_session import place_session
from mapping.scoring.held_out import (
    BlockScores,
    Judged,
    Mixture,
    as_occupied,
    blocks_of,
    fan_of,
    held_out,
)
from recorder.errors import BadInput
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS
from tests.naive_held_out import chances_of_the_end, likelihood

STEP_M = 0.05
SHARES = Mixture().shares


def judged(grid: np.ndarray, fan: np.ndarray, *, at: tuple[float, float], heading: float,
           ranges_m: list[float], reach_m: float) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    count = len(ranges_m)
    x, y = (np.full(count, v) for v in at)
    found, expected = log_likelihoods(
        grid[None], np.zeros(count, np.int64), x, y, np.full(count, heading), fan,
        np.array(ranges_m) / STEP_M, np.full(count, reach_m / STEP_M), STEP_M, SHARES, 0.01, 0.04,
    )  # fmt: skip
    return found, expected


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 1000),
    heading=st.floats(-3.2, 3.2),
    width=st.sampled_from([0.0, 0.3, 0.7]),
    reach_m=st.floats(0.3, 1.5),
)
def test_the_kernel_is_its_slow_twin(
    seed: int, heading: float, width: float, reach_m: float
) -> None:
    rng = np.random.default_rng(seed)
    grid = rng.choice([0.0, 0.02, 0.6], (24, 30), p=[0.5, 0.4, 0.1]).astype(np.float32)
    at = (float(rng.uniform(0, 30)), float(rng.uniform(0, 24)))
    ranges_m = [*rng.uniform(0.02, reach_m, 4).tolist(), math.inf]
    fan = fan_of(width)
    found, expected = judged(
        grid, fan, at=at, heading=heading, ranges_m=ranges_m, reach_m=reach_m
    )  # fmt: skip
    headings = [heading + turn for turn in fan.tolist()]
    ends = chances_of_the_end(grid, *at, headings, reach_m / STEP_M)
    for value, range_m in zip(found, ranges_m, strict=True):
        slow = likelihood(ends, range_m, reach_m, STEP_M, SHARES, 0.01, 0.04)
        assert value == pytest.approx(math.log(slow), abs=2e-3)
    reached = np.flatnonzero(np.cumsum(ends[:-1]) > 0.5 - 1e-9)
    if len(reached) and not math.isinf(expected[0]):
        assert expected[0] == pytest.approx((reached[0] + 0.5) * STEP_M)


def test_all_that_can_be_measured_has_probability_one() -> None:
    grid = np.full((20, 60), 0.01, np.float32)
    grid[:, 40] = 0.7
    reach_m, dz_m = 3.0, 0.002
    ranges_m = [*np.arange(dz_m / 2, 3.4, dz_m).tolist(), math.inf]
    found, _ = judged(grid, np.zeros(1), at=(1.0, 10.5), heading=0.0, ranges_m=ranges_m,
                      reach_m=reach_m)  # fmt: skip
    inside = np.array(ranges_m) <= reach_m
    density = np.exp(found[:-1])
    density[~inside[:-1]] -= SHARES[3] / reach_m  # random ranges lie within the reach
    beyond = ~inside[:-1]
    density[beyond] -= SHARES[1] / reach_m * np.prod(1.0 - grid[10, 1:])
    assert density.sum() * dz_m + math.exp(found[-1]) == pytest.approx(1.0, abs=0.01)


def test_a_wall_is_expected_where_it_is() -> None:
    grid = as_occupied(np.full((20, 40), 0.2), STEP_M)
    grid[:, 30] = 0.99
    found, expected = judged(grid, np.zeros(1), at=(0.0, 10.0), heading=0.0,
                             ranges_m=[1.525, 0.7, math.inf], reach_m=2.0)  # fmt: skip
    assert expected == pytest.approx(1.525)
    assert found[0] > found[1] + 2.0 > found[2]


def test_a_session_has_blocks_of_neighbours() -> None:
    block, blocks = blocks_of(1030)
    assert blocks == len(set(block.tolist())) == 20
    assert (np.diff(block) >= 0).all()
    assert np.ptp(np.bincount(block)) <= 1
    assert blocks_of(20_000)[1] == 100
    assert blocks_of(5)[1] == 1


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_an_interval_holds_its_mean_and_a_score_gains_nothing_over_itself(seed: int) -> None:
    rng = np.random.default_rng(seed)
    block, blocks = blocks_of(400)
    scores = BlockScores.of(rng.standard_normal(400), block, blocks)
    low, high = scores.interval()
    assert low <= scores.mean <= high
    gain = scores.gain_over(scores)
    assert gain.mean == gain.low == gain.high == 0.0


def test_intervals_hold_the_truth_about_as_often_as_they_claim() -> None:
    rng, held = np.random.default_rng(3), 0
    block, blocks = blocks_of(600)
    for _ in range(150):
        of_block = rng.standard_normal(blocks)  # neighbours err together
        low, high = BlockScores.of(of_block[block] + rng.standard_normal(600), block,
                                   blocks).interval()  # fmt: skip
        held += low <= 0.0 <= high
    assert 0.85 <= held / 150 <= 0.99


def score(*settings: str) -> Judged:
    config = load_config([], ["grid.resolution_m=0.02", *settings])
    messages = [m for _, m in simulate(ROOMS["room"], duration_s=60.0, seed=4)]
    placed = place_session(messages, config)
    return held_out(placed, config, geometry_of(placed, config))


def test_a_turned_mount_and_a_late_pose_cost_by_the_score() -> None:
    right = score()
    for setting in ("sensors.dirrs.mount=[-0.0312,0,8]", "pose.offset_s=0.2"):
        gain = right.gain_over(score(setting), ["dirrs"])
        assert gain.low > 0.0, setting


def test_every_reading_is_judged_in_the_fold_of_its_block() -> None:
    found = score()
    assert len(found.log_likelihood) == len(found.readings.ranges_m)
    both = [found.of_sensors([name]) for name in ("ping", "dirrs")]
    assert np.array_equal(both[0].count + both[1].count, found.scores.count)
    assert found.scores.mean == pytest.approx(found.log_likelihood.mean())


def test_too_few_readings_are_refused() -> None:
    messages = [m for _, m in simulate(ROOMS["room"], duration_s=1.0, seed=4)][:14]
    config = load_config()
    placed = place_session(messages, config)
    assert 1 <= sum(placed.counts.used.values()) < 10
    with pytest.raises(BadInput, match="too few"):
        held_out(placed, config, geometry_of(placed, config))
