"""What was learned, in an engineer's words, as a sensor file, and as CSV."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from mapping.learning.sensors import LearnedSensor
from replay.json_values import json_value


def verdict(learned: LearnedSensor) -> list[str]:
    """What to make of a sensor, a sentence a line."""
    fit, mixture = learned.fit, learned.fit.mixture
    low_m, high_m = learned.usable_m
    lines = []
    if math.isnan(low_m):
        lines.append("At no distance are 40 % of its readings right: do not use it as it is.")
    else:
        lines.append(f"Use it from {_length(low_m)} to {_length(high_m)}.")
    if "scale" not in fit.fixed:
        lines.append(_off(learned))
    typical_m = learned.typical_m
    lines.append(
        f"A right reading spreads by {100 * float(mixture.std_m(typical_m)):.1f} cm at "
        f"{_length(typical_m)} (one standard deviation)."
    )
    if learned.beam_width_rad is not None and learned.beam_interval_rad is not None:
        low, high = (math.degrees(each) for each in learned.beam_interval_rad)
        thin = learned.beam_width_rad == 0.0
        lines.append(
            f"Its beam is as thin as a line (under {max(high, 1.0):.0f} degrees)."
            if thin
            else f"Its beam is as if {math.degrees(learned.beam_width_rad):.0f} degrees wide "
            f"({low:.0f} to {high:.0f})."
        )
    lines.append(
        f"{_percent(mixture.hit)} of its readings are right, {_percent(mixture.short)} too short, "
        f"{_percent(mixture.none)} without echo; {_percent(learned.long)} of the echoes come from "
        "farther away than what is nearest (mirrored)."
    )
    if learned.tuned is not None:
        lines.append(
            f"By {learned.against} alone: the spread holds its blur. "
            + ("A band of another depth predicts better." if learned.tuned
               else "No other band predicts its readings surely better: none is set.")
        )  # fmt: skip
    return [*lines, *_where_lost(learned)]


def _off(learned: LearnedSensor) -> str:
    mixture, interval = learned.fit.mixture, learned.fit.interval
    parts = []
    low, high = interval["scale"]
    if not low <= 1.0 <= high:
        more = "long" if mixture.scale > 1.0 else "short"
        parts.append(f"{100 * abs(mixture.scale - 1.0):.1f} % {more}")
    low, high = interval["bias_m"]
    if not low <= 0.0 <= high:
        more = "long" if mixture.bias_m > 0.0 else "short"
        parts.append(f"{100 * abs(mixture.bias_m):.1f} cm {more}")
    return f"It reads {' and '.join(parts)}." if parts else "It reads neither long nor short."


def _where_lost(learned: LearnedSensor) -> Iterator[str]:
    bad = [each for each in learned.by_incidence if each.hit < 0.5]
    if bad and learned.by_incidence[0].hit >= 0.5:
        yield f"What it meets at more than {bad[0].from_deg:.0f} degrees it mostly misses."


def _length(metres: float) -> str:
    return f"{100 * metres:.0f} cm" if metres < 1.0 else f"{metres:.1f} m"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def sensor_file(learned: Iterable[LearnedSensor], sources: Sequence[str]) -> str:
    """What ``map --config`` takes, with the verdict as comments."""
    parts = [f"# learned from {', '.join(sources)}"]
    for each in learned:
        parts += ["", *(f"# {line}" for line in verdict(each))]
        parts.append(f"[sensors.{each.sensor.name}]")
        parts += [f"{key} = {value!r}" for key, value in each.settings().items()]
    return "\n".join(parts) + "\n"


def table(learned: LearnedSensor) -> list[list[str]]:
    """The fitted numbers with their intervals."""
    rows = [[f"{learned.sensor.name}, against {learned.against}", "value", "95 % interval"]]
    names = {
        "hit": "right", "short": "too short", "none": "no echo", "random": "anything",
        "bias_m": "bias, m", "scale": "scale", "spread_m": "spread, m", "spread_rel": "and per m",
        "short_per_m": "short, 1/m",
    }  # fmt: skip
    for name, title in names.items():
        if name in learned.fit.fixed:
            continue
        low, high = learned.fit.interval.get(name, (math.nan, math.nan))
        interval = "-" if math.isnan(low) else f"{low:.4f} .. {high:.4f}"
        rows.append([title, f"{getattr(learned.fit.mixture, name):.4f}", interval])
    return rows


def as_json(learned: Iterable[LearnedSensor]) -> dict[str, Any]:
    """The figures by sensor; what is not known is null."""
    return {
        each.sensor.name: json_value({
            "against": each.against, "readings": each.fit.readings,
            "mixture": each.fit.mixture, "interval": dict(each.fit.interval),
            "beam_width_deg": _degrees(each.beam_width_rad), "mirrored": each.long,
            "usable_m": list(each.usable_m), "settings": each.settings(),
            "verdict": verdict(each),
            "by_range": each.by_range,
            "by_incidence": each.by_incidence,
        }, nulls=True)
        for each in learned
    }  # fmt: skip


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else math.degrees(angle_rad)


def csv(learned: Iterable[LearnedSensor]) -> str:
    """Every reading with what it should have been, a row each."""
    rows = ["sensor,true_m,range_m,hit_share"]
    for each in learned:
        for true_m, range_m, share in zip(
            each.pairs.true_m.tolist(), each.pairs.range_m.tolist(), each.hit_share.tolist(),
            strict=True,
        ):  # fmt: skip
            rows.append(f"{each.sensor.name},{true_m:.4f},{range_m:.4f},{share:.3f}")
    return "\n".join(rows) + "\n"
