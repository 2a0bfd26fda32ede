"""What is learned of a sensor: planted numbers come back, with intervals that hold them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from mapping.config import MappingConfig, load_config
from mapping.learning.known_ranges import as_measured, from_tape, from_walls
from mapping.learning.mixture import NAMES, BeamMixture, Pairs, fit_mixture
from mapping.learning.near_far import near_and_far
from mapping.learning.sensors import learn_sensor
from mapping.placed_session import place_session
from recorder.errors import BadInput
from recorder.simulator.faults import RunFaults, SensorFaults
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS
from replay.learning.text import sensor_file, verdict

TRUE = BeamMixture(0.75, 0.12, 0.05, 0.08, 0.02, 1.02, 0.01, 0.02, 0.8)
REACH_M = 4.0
READINGS, SEEDS = 5000, 20


def drawn(mixture: BeamMixture, count: int, seed: int) -> Pairs:
    """Readings of a sensor that is like that; the short ones by inverting their distribution."""
    rng = np.random.default_rng(seed)
    d = rng.uniform(0.2, 3.0, count)
    shares = [mixture.hit, mixture.short, mixture.none, mixture.random]
    cause = rng.choice(4, count, p=shares)
    hit = mixture.mean_m(d) + mixture.std_m(d) * rng.standard_normal(count)
    rate = mixture.short_per_m
    short = -np.log1p(rng.random(count) * np.expm1(-rate * d)) / rate
    ranges = np.select(
        [cause == 0, cause == 1, cause == 2], [hit, short, math.inf], REACH_M * rng.random(count)
    )
    return Pairs(ranges, d, REACH_M, np.arange(count))


def test_planted_numbers_come_back_and_intervals_hold_them():
    """5,000 readings, 20 seeds: the mean within 10 % of the truth, each within its own interval in
    about 95 % of the cases. (Alone, the short readings' rate is known to 14 % from so many.)"""
    fits = [fit_mixture(drawn(TRUE, READINGS, seed)) for seed in range(SEEDS)]
    found = np.array([fit.mixture.values for fit in fits])
    np.testing.assert_allclose(found.mean(axis=0), TRUE.values, rtol=0.05)
    off = np.sqrt(np.square(found / TRUE.values - 1.0).mean(axis=0))
    assert off[NAMES.index("short_per_m")] < 0.2
    assert np.delete(off, NAMES.index("short_per_m")).max() < 0.1
    held = [
        fit.interval[name][0] <= value <= fit.interval[name][1]
        for fit in fits
        for name, value in zip(NAMES, TRUE.values, strict=True)
    ]
    assert 0.90 <= np.mean(held) <= 0.995


def test_it_is_the_greatest_likelihood_that_there_is():
    """A general optimiser, started there, finds nothing better."""
    pairs = drawn(TRUE, 1500, 3)
    fit = fit_mixture(pairs)

    def loss(values):
        hit, short, none, *rest = values
        if min(hit, short, none, 1 - hit - short - none, *rest[2:]) <= 0.0:
            return 1e9
        mixture = BeamMixture(hit, short, none, 1 - hit - short - none, *rest)
        return -float(mixture.log_likelihoods(pairs).mean())

    start = np.delete(fit.mixture.values, NAMES.index("random"))
    best = minimize(loss, start, method="Nelder-Mead", options={"maxfev": 1500, "xatol": 1e-6})
    assert -best.fun == pytest.approx(fit.log_likelihood, abs=2e-4)


def test_densities_are_densities():
    grid = np.linspace(0.0, REACH_M, 40_001)
    pairs = Pairs(grid, np.full_like(grid, 1.5), REACH_M, np.arange(len(grid)))
    density = TRUE.densities(pairs).sum(axis=1)
    assert np.trapezoid(density, grid) == pytest.approx(1.0 - TRUE.none, abs=1e-3)
    silent = Pairs(np.array([math.inf]), np.array([1.5]), REACH_M, np.zeros(1, np.int64))
    assert TRUE.densities(silent).sum() == pytest.approx(TRUE.none)


def test_readings_that_err_together_widen_the_interval():
    """The same readings ten times over are no more than once."""
    once = drawn(TRUE, 500, 1)
    often = Pairs(*(np.tile(v, 10) for v in (once.range_m, once.true_m)), REACH_M,
                  np.tile(once.block, 10))  # fmt: skip
    alone = replace(often, block=np.arange(len(often.range_m)))
    width = {
        name: np.subtract(*fit_mixture(pairs).interval["bias_m"][::-1])
        for name, pairs in (("once", once), ("often", often), ("alone", alone))
    }
    assert width["often"] == pytest.approx(width["once"], rel=0.1)
    assert width["alone"] < 0.5 * width["once"]


def test_a_sensor_without_short_readings_has_an_interval_still():
    sound = BeamMixture(0.95, 0.0, 0.0, 0.05, 0.0, 1.0, 0.01, 0.01, 1.0)
    fit = fit_mixture(drawn(sound, 2000, 2))
    assert fit.interval["none"] == (0.0, pytest.approx(0.0015))
    assert 0.0 <= fit.interval["short"][0] <= fit.interval["short"][1] < 0.02
    assert fit.interval["hit"][1] <= 1.0


def learned(name, **faults):
    run_faults = RunFaults(sensors={name: SensorFaults(**faults)})
    pairs = simulate(ROOMS["square"], duration_s=60.0, seed=5, sensors=(name,), faults=run_faults)
    placed = place_session([m for _, m in pairs], as_measured(MappingConfig()))
    return learn_sensor(from_walls(placed, name, ROOMS["square"].walls_m), "true walls")


def test_faults_that_were_planted_in_a_session_are_learned():
    infrared = learned("dirrs", scale=1.08).settings()
    assert infrared["range_scale"] == pytest.approx(1.08, abs=0.02)
    assert infrared["before"] == pytest.approx(2.5 * 0.033, rel=0.3)
    assert "beam_width_deg" not in infrared  # a thin line: the stated beam stays
    sonar = learned("ping", bias_m=0.05)
    assert sonar.fit.mixture.bias_m == pytest.approx(0.05, abs=0.01)
    assert 0.05 < sonar.fit.mixture.none < 0.2
    slanted = [each.hit for each in sonar.by_incidence if 30.0 <= each.from_deg < 60.0]
    assert sonar.by_incidence[0].hit > 0.8 > 0.6 > min(slanted)  # walls are mirrors


def test_a_sound_sensor_is_left_as_it_is():
    settings = learned("dirrs").settings()
    assert "range_scale" not in settings or abs(settings["range_scale"] - 1.0) < 0.02


def test_by_tape_measure():
    rng, distances = np.random.default_rng(1), [0.3, 0.6, 0.9]
    sensor = learned("dirrs").sensor
    far = replace(sensor, max_range_m=1.5)
    ranges = [1.02 * d + 0.01 + 0.01 * rng.standard_normal(200) for d in distances]
    mixture = learn_sensor(from_tape(far, ranges, distances), "a tape measure").fit.mixture
    assert mixture.scale == pytest.approx(1.02, abs=0.01)
    assert mixture.bias_m == pytest.approx(0.01, abs=0.005)


def near_and_far_readings(seed, near=0.01, far=0.04, up_to_m=0.8, count=5000):
    """Readings whose spread is another share of the range beyond a place."""
    pairs = drawn(replace(TRUE, hit=0.0, short=0.5, none=0.2, random=0.3), count, seed)
    rng = np.random.default_rng(seed + 100)
    spread = np.where(pairs.true_m <= up_to_m, near, far) * pairs.true_m
    right = pairs.true_m + spread * rng.standard_normal(count)
    ranges_m = np.where(rng.random(count) < 0.8, right, pairs.range_m)
    return Pairs(ranges_m, pairs.true_m, REACH_M, np.arange(count) // 50)


def test_different_spreads_near_and_far_come_back():
    for seed in range(4):
        pairs = near_and_far_readings(seed)
        found = near_and_far(fit_mixture(pairs).mixture, pairs)
        assert found.up_to_m == pytest.approx(0.8, abs=0.04)
        assert found.near == pytest.approx(0.01, rel=0.15)
        assert found.far == pytest.approx(0.04, rel=0.1)
        assert found.gain > 5.0 * found.gain_error


def test_one_spread_stays_one():
    for seed in range(4):
        pairs = near_and_far_readings(seed, near=0.03, far=0.03)
        assert near_and_far(fit_mixture(pairs).mixture, pairs) is None


def test_two_models_go_into_the_sensor_file_and_words_tell_what_was_not_met(tmp_path):
    pairs = near_and_far_readings(1)
    sensor = replace(learned("dirrs").sensor, max_range_m=REACH_M)
    known = from_tape(sensor, [pairs.range_m], [1.0])
    known = replace(known, true_m=pairs.true_m[:, None], block=pairs.block)
    of = learn_sensor(known, "true walls")
    (near,) = of.settings()["ranges"]
    assert near["up_to_m"] == pytest.approx(0.8, abs=0.04)
    assert near["range_error"] == pytest.approx(0.02, rel=0.15)
    assert of.settings()["range_error"] == pytest.approx(0.08, rel=0.1)
    assert near["before"] < 0.5 * of.settings()["before"]
    (tmp_path / "s.toml").write_text(sensor_file([of], ["made up"]))
    section = load_config([tmp_path / "s.toml"]).sensors["dirrs"].model_dump(exclude_none=True)
    assert section["ranges"][0]["range_error"] == near["range_error"]
    text = " ".join(verdict(of))
    assert "Use it from 20 cm to 3.0 m; nearer and farther nothing was met" in text
    assert "Two models, picked by range" in text


def test_where_a_sensor_stops_being_right_is_its_own_limit():
    pairs = drawn(TRUE, 4000, 4)
    wild = np.where(pairs.true_m > 1.5, REACH_M * np.random.default_rng(1).random(4000),
                    pairs.range_m)  # fmt: skip
    known = from_tape(replace(learned("ping").sensor, max_range_m=REACH_M), [wild], [1.0])
    text = verdict(learn_sensor(replace(known, true_m=pairs.true_m[:, None]), "true walls"))
    assert text[0].startswith("Use it from 20 cm to 1.")
    assert "; nearer nothing was met" in text[0]
    assert "farther" not in text[0]


def test_mirrored_is_said_only_where_slanted_walls_make_the_long_echoes():
    sonar = learned("ping")
    (long,) = [line for line in verdict(sonar) if "farther away than what is nearest" in line]
    assert "mostly mirrored" in long
    even = tuple(replace(each, long=0.1) for each in sonar.by_incidence)
    (long,) = [
        line for line in verdict(replace(sonar, long=0.1, by_incidence=even))
        if "farther away" in line
    ]  # fmt: skip
    assert "they were not told apart" in long


def test_too_few_readings_are_refused():
    with pytest.raises(BadInput, match="50 are needed"):
        fit_mixture(drawn(TRUE, 40, 1))
