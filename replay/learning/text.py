"""What was learned, in an engineer's words, as a sensor file, and as CSV."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from mapping.learning.known_ranges import REACHED
from mapping.learning.sensors import IncidenceBin, LearnedSensor
from mapping.learning.strengths import LearnedStrengths
from replay.json_values import json_value

_STEEP_DEG, _SLANTED_DEG = 20.0, 30.0
_WORTH_NAMING = 0.02  # of the echoes


def verdict(learned: LearnedSensor) -> list[str]:
    """What to make of a sensor, a sentence a line."""
    fit, mixture = learned.fit, learned.fit.mixture
    lines = [_usable(learned)]
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
        f"{_percent(mixture.none)} without echo, {_percent(mixture.random)} anything."
    )
    lines.append(_too_long(learned))
    if learned.near_far is not None:
        parted = learned.near_far
        lines.append(
            f"Near and far it spreads otherwise: {100 * parted.near:.1f} % of the range up to "
            f"{_length(parted.up_to_m)}, {100 * parted.far:.1f} % beyond. Two models, picked by "
            "range, explain readings that were kept out surely better than one."
        )
    if learned.tuned is not None:
        lines.append(
            f"By {learned.against} alone: the spread holds its blur. "
            + ("A band of another depth predicts better." if learned.tuned
               else "No other band predicts its readings surely better: none is set.")
        )  # fmt: skip
    return [*lines, *_where_lost(learned)]


def _usable(learned: LearnedSensor) -> str:
    """Where to use it, and which of the limits are only those of what was met."""
    low_m, high_m = learned.usable_m
    if math.isnan(low_m):
        return "At no distance are 40 % of its readings right: do not use it as it is."
    least_m = learned.sensor.min_range_m  # nearer it reports nothing that is taken
    nearest = least_m < low_m <= learned.by_range[0].to_m
    low_m = max(low_m, least_m)
    farthest = high_m >= learned.by_range[-1].from_m
    judged_m = REACHED * learned.sensor.max_range_m
    farther = "farther" if high_m < 0.97 * judged_m else f"beyond {_length(judged_m)}"
    if farther != "farther" and farthest:
        unknown = f"{farther}, {100 * REACHED:.0f} % of its reach, it is not judged"
        unknown += "; nearer nothing was met" if nearest else ""
    elif nearest or farthest:
        unknown = " and ".join(["nearer"] * nearest + ["farther"] * farthest)
        unknown += " nothing was met: the sensor's own limits there are not known"
    else:
        unknown = "nearer and farther, fewer than 40 % of its readings are right"
    return f"Use it from {_length(low_m)} to {_length(high_m)}; {unknown}."


def _too_long(learned: LearnedSensor) -> str:
    """How many echoes come from farther away than what is nearest, and whether as of mirrors."""
    share = f"{_percent(learned.long)} of its echoes come from farther away than what is nearest"
    steep, slanted = (
        [each for each in learned.by_incidence if low <= each.from_deg < high]
        for low, high in ((0.0, _STEEP_DEG), (_SLANTED_DEG, 90.0))
    )
    if learned.long < _WORTH_NAMING:
        return f"{share}."
    if steep and slanted:
        few, many = (_mean_long(bins) for bins in (steep, slanted))
        if many >= 2.0 * few + _WORTH_NAMING:
            return (
                f"{share}: {_percent(many)} where that is met at more than {_SLANTED_DEG:.0f} "
                f"degrees, {_percent(few)} where head-on, so mostly mirrored."
            )
    return f"{share}: mirrored, past an edge, or not of this room; they were not told apart."


def _mean_long(bins: Sequence[IncidenceBin]) -> float:
    known = [each for each in bins if not math.isnan(each.long)]
    total = sum(each.readings for each in known)
    return sum(each.readings * each.long for each in known) / max(total, 1)


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


def worth(strengths: LearnedStrengths) -> list[str]:
    """How strong a layer's evidence should be, and what that is worth, a sentence a line."""
    names = ", ".join(strengths.sensors)
    shown = {key: value for key, value in strengths.settings.items() if key != "weights"}
    what = ", ".join(f"{key} {value:g}" for key, value in shown.items()) or "weights of its sums"
    kept = "another time in the same room" if strengths.same_room else "rooms"
    turns = f"kept out in turn ({len(strengths.kept_out)})"
    lines = [f"Evidence of {names} by the rule {strengths.rule}: {what}."]
    if strengths.by_walls:
        lines.append(
            f"Log-loss of maps of {kept}, {turns}: with what was learned of the others "
            f"{strengths.learned:.3f}, as it was {strengths.before:.3f} (undecided: 0.693)."
        )
    else:
        lines.append(
            f"Log-likelihood of readings of other times, {turns}: with what was learned "
            f"{-strengths.learned:.3f}, as it was {-strengths.before:.3f} (higher is better)."
        )
    if not strengths.is_better:
        lines.append("That is not better: the file leaves them as they are.")
    elif strengths.same_room:
        lines.append("Another room would tell more: give sessions of several.")
    return lines


def sensor_file(
    learned: Iterable[LearnedSensor],
    sources: Sequence[str],
    strengths: Sequence[LearnedStrengths] = (),
) -> str:
    """What ``map --config`` takes, with the verdict as comments."""
    parts = [f"# learned from {', '.join(sources)}"]
    notes: dict[str, list[str]] = {}
    keys: dict[str, dict[str, Any]] = {}
    for each in learned:
        notes[each.sensor.name], keys[each.sensor.name] = verdict(each), each.settings()
    for layer in strengths:
        for name in layer.sensors:
            notes[name] = [*notes.get(name, []), *worth(layer)]
            keys[name] = {**keys.get(name, {}), **(layer.settings if layer.is_better else {})}
    for name, values in keys.items():
        parts += ["", *(f"# {line}" for line in notes[name]), *_section(f"sensors.{name}", values)]
    return "\n".join(parts) + "\n"


def _section(path: str, values: Mapping[str, Any]) -> list[str]:
    """A table of TOML: its own keys first, as those of inner tables would take what follows."""
    lines, inner = [f"[{path}]"], []
    for key, value in values.items():
        if isinstance(value, Mapping):
            inner += _section(f"{path}.{key}", value)
        elif isinstance(value, list):
            for each in value:
                inner += [f"[[{path}.{key}]]", *(f"{k} = {v!r}" for k, v in each.items())]
        else:
            lines.append(f"{key} = {value!r}")
    return [*lines, *inner]


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


def as_json(
    learned: Iterable[LearnedSensor], strengths: Sequence[LearnedStrengths] = ()
) -> dict[str, Any]:
    """The figures by sensor; what is not known is null."""
    worth = {name: {"strengths": json_value(each, nulls=True)}
             for each in strengths for name in each.sensors}  # fmt: skip
    figures: dict[str, Any] = {
        each.sensor.name: json_value({
            "against": each.against, "readings": each.fit.readings,
            "mixture": each.fit.mixture, "interval": dict(each.fit.interval),
            "beam_width_deg": _degrees(each.beam_width_rad), "mirrored": each.long,
            "usable_m": list(each.usable_m), "met_m": list(each.met_m),
            "near_far": each.near_far, "settings": each.settings(),
            "verdict": verdict(each),
            "by_range": each.by_range,
            "by_incidence": each.by_incidence,
        }, nulls=True)
        for each in learned
    }  # fmt: skip
    for name, more in worth.items():
        figures[name] = {**figures.get(name, {}), **more}
    return figures


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
