"""What ``diagnose`` names where a fault was planted, and where none was: a confusion table.

``python -m benchmarks.diagnosis`` simulates 20 sessions of each fault, in eight rooms, and takes
about an hour; ``--quick`` four of each, half as long. ``--only late`` runs the faults whose names
hold that word. The table is Markdown, as docs/diagnose.md shows it.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from mapping.config import load_config
from mapping.diagnosis.causes.interface import Suspect
from mapping.diagnosis.diagnosing import Diagnosis, diagnose
from mapping.placed_session import HasBlocks
from recorder.columns import ALL, Block, Choice, blocks_of
from recorder.geometry import SE2
from recorder.messages import Range, Record, topic_of
from recorder.simulator.faults import SOUND, RunFaults, SensorFaults
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS

DURATION_S, QUICK_S = 280.0, 200.0
SEEDS, QUICK_SEEDS = 20, 4
TEN_MS, ONE_DEG, FIVE_MM, HALF_PERCENT = 0.010, math.radians(1.0), 0.005, 0.005
Check = Callable[[Suspect], bool]


@dataclass(frozen=True, slots=True)
class Planted:
    """A fault: how it is planted, which cause it is, and how near the amount must be."""

    name: str
    faults: Callable[[int], RunFaults]
    cause: str
    near: Callable[[Suspect, int], bool] = lambda suspect, seed: True
    also: str = ""
    swap_s: float | None = None
    sensors: tuple[str, ...] = ("ping", "dirrs")
    mounts: Mapping[str, SE2] = field(default_factory=dict)


class Kept:
    """Messages as a session that can be gone through again and again."""

    def __init__(self, messages: list[Record]) -> None:
        self._blocks = list(blocks_of(messages))

    def blocks(self, choice: Choice = ALL) -> Iterator[Block]:
        """What of it is wanted."""
        return map(choice.of, self._blocks)


def _sensor(name: str, **faults: object) -> RunFaults:
    return replace(SOUND, sensors={name: SensorFaults(**faults)})  # type: ignore[arg-type]


def _sign(seed: int) -> int:
    return 1 if seed % 2 else -1


def _delay(seed: int) -> float:
    return (0.05, 0.1, 0.15, 0.2)[seed % 4] * _sign(seed // 4)


def _yaw(seed: int) -> float:
    return math.radians((2.0, 5.0, 10.0, 15.0)[seed % 4]) * _sign(seed // 4)


def _shift(seed: int) -> float:
    return (0.01, 0.02, 0.03, 0.05)[seed % 4] * _sign(seed // 4)


def _scale(seed: int) -> float:
    return 1.0 + 0.03 * _sign(seed)


def _off(value: float, by: float) -> Check:
    return lambda suspect: suspect.value is not None and abs(suspect.value - value) <= by


PLANTED = (
    Planted("none", lambda seed: SOUND, ""),
    Planted("pose 50 to 200 ms late or early",
            lambda seed: replace(SOUND, pose_delay_s=_delay(seed)), "pose-time",
            lambda s, seed: _off(-_delay(seed), TEN_MS)(s)),
    Planted("infrared turned 2 to 15 degrees",
            lambda seed: _sensor("dirrs", mount=SE2(0.0, 0.0, _yaw(seed))),
            "mount", lambda s, seed: s.unit == "rad" and _off(_yaw(seed), ONE_DEG)(s)),
    Planted("infrared shifted 1 to 5 cm sideways",
            lambda seed: _sensor("dirrs", mount=SE2(0.0, _shift(seed), 0.0)),
            "mount", lambda s, seed: s.unit == "m" and _off(_shift(seed), FIVE_MM)(s)),
    Planted("sonar turned 15 degrees",
            lambda seed: _sensor("ping", mount=SE2(0.0, 0.0, math.radians(15.0) * _sign(seed))),
            "mount", lambda s, seed: _off(math.radians(15.0) * _sign(seed), ONE_DEG)(s)),
    Planted("infrared scale 3 %", lambda seed: _sensor("dirrs", scale=_scale(seed)),
            "range", lambda s, seed: s.unit == "times" and _off(_scale(seed), HALF_PERCENT)(s)),
    Planted("infrared bias 2 cm", lambda seed: _sensor("dirrs", bias_m=0.02 * _sign(seed)),
            "range", lambda s, seed: s.unit == "m" and _off(0.02 * _sign(seed), FIVE_MM)(s)),
    Planted("sonar beam half as wide", lambda seed: _sensor("ping", beam_width_deg=19.0), "beam",
            lambda s, seed: (s.value or 0.0) < 1.0),
    Planted("sonar beam twice as wide", lambda seed: _sensor("ping", beam_width_deg=76.0), "beam",
            lambda s, seed: (s.value or 0.0) > 1.0),
    Planted("channels swapped", lambda seed: replace(SOUND, sensors={
        "ping": SensorFaults(reports_as="dirrs"), "dirrs": SensorFaults(reports_as="ping")}),
        "channels"),
    Planted("channels swapped midway", lambda seed: SOUND, "channels",
            lambda s, seed: abs((s.value or 0.0) - 100.0) < 5.0, swap_s=100.0),
    Planted("infrared stuck for 20 s", lambda seed: _sensor("dirrs", stuck_s=(60.0, 80.0)),
            "silence"),
    Planted("15 % cross-talk of two sonars", lambda seed: replace(SOUND, cross_talk=0.15),
            "cross-talk", sensors=("ping_left", "ping", "dirrs"),
            mounts={"ping_left": SE2(0.0, 0.044, math.pi / 2)}),
    Planted("late and turned", lambda seed: replace(
        _sensor("dirrs", mount=SE2(0.0, 0.0, _yaw(seed))), pose_delay_s=_delay(seed + 1)),
        "pose-time", lambda s, seed: _off(-_delay(seed + 1), TEN_MS)(s), also="mount"),
    Planted("turned, and the channels swapped", lambda seed: replace(SOUND, sensors={
        "ping": SensorFaults(reports_as="dirrs"),
        "dirrs": SensorFaults(reports_as="ping", mount=SE2(0.0, 0.0, _yaw(seed)))}),
        "channels", also="mount"),
    Planted("headings 5 degrees off",
            lambda seed: replace(SOUND, heading_bias_deg=5.0 * _sign(seed)), "heading",
            lambda s, seed: _off(math.radians(-5.0) * _sign(seed), ONE_DEG)(s)),
    Planted("headings 5 degrees off, two infrared",
            lambda seed: replace(SOUND, heading_bias_deg=5.0 * _sign(seed)), "heading",
            lambda s, seed: _off(math.radians(-5.0) * _sign(seed), ONE_DEG)(s),
            sensors=("ping", "dirrs", "dirrs_left"),
            mounts={"dirrs_left": SE2(0.0, 0.03, math.pi / 2)}),
    Planted("headings drift by 2 degrees a minute",
            lambda seed: replace(SOUND, pose_drift_degpmin=2.0 * _sign(seed)), "drift",
            lambda s, seed: s.unit == "rad/s"
            and _off(math.radians(2.0 / 60.0) * _sign(seed), math.radians(0.3 / 60.0))(s)),
    Planted("places drift by 5 cm a minute",
            lambda seed: replace(SOUND, pose_drift_mpmin=0.05), "drift",
            lambda s, seed: s.unit == "m/s"),
    Planted("half of the sonar's ranges at random", lambda seed: _sensor("ping", random=0.5),
            "far-echoes"),
)  # fmt: skip


def session_of(planted: Planted, seed: int, duration_s: float) -> HasBlocks:
    """One simulated run with the fault."""
    names = list(ROOMS)[:8]
    room = ROOMS[names[seed % len(names)]]
    messages = simulate(
        room, duration_s=duration_s, seed=1000 + seed, sensors=planted.sensors,
        faults=planted.faults(seed), mounts=planted.mounts,
    )  # fmt: skip
    records, start_ns = [], None
    for log_ns, message in messages:
        start_ns = log_ns if start_ns is None else start_ns
        late = planted.swap_s is not None and log_ns - start_ns > planted.swap_s * 1e9
        if late and isinstance(message, Range):
            message = _as_other(message)
        records.append(Record(topic_of(message), log_ns, message))
    return Kept(records)


def _as_other(message: Range) -> Range:
    """The same range on the channel of the other sensor."""
    from recorder.sensors import CATALOGUE

    other = "dirrs" if message.sensor == "ping" else "ping"
    return CATALOGUE[other].parameters.reading(message.t_ns, other, message.range_m)


def verdict(planted: Planted, seed: int, found: Diagnosis) -> tuple[str, bool, bool]:
    """The cause named first, whether it is the right one, and by the right amount.

    Of two faults either may be named first, and the other one must be named too.
    """
    causes = [each.cause for each in found.suspects]
    first = causes[0] if causes else "none"
    if not planted.cause:
        return first, not causes, not causes
    wanted = {planted.cause, planted.also} - {""}
    named = first in wanted and wanted <= set(causes)
    mine = [each for each in found.suspects if each.cause == planted.cause]
    return first, named, named and any(planted.near(each, seed) for each in mine)


def main() -> None:
    """Run, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="four sessions of each fault")
    parser.add_argument("--seeds", type=int, help="sessions of each fault")
    parser.add_argument("--only", default="", help="faults whose names hold this")
    asked = parser.parse_args()
    seeds = asked.seeds or (QUICK_SEEDS if asked.quick else SEEDS)
    duration_s = QUICK_S if asked.quick else DURATION_S
    print("| planted | named first | and by the right amount | named first, how often | CPU, s |")
    print("|---|---|---|---|---|")
    for planted in PLANTED:
        if asked.only in planted.name:
            print(_row(planted, seeds, duration_s), flush=True)


def _row(planted: Planted, seeds: int, duration_s: float) -> str:
    firsts: Counter[str] = Counter()
    named = right = 0
    spent_s = 0.0
    for seed in range(seeds):
        session = session_of(planted, seed, duration_s)
        began_s = time.process_time()
        found = diagnose(session, load_config())
        spent_s += time.process_time() - began_s
        first, is_named, is_right = verdict(planted, seed, found)
        firsts[first] += 1
        named, right = named + is_named, right + is_right
        texts = "; ".join(f"{s.text} ({s.cost:.3f})" for s in found.suspects)
        print(f"{planted.name}, seed {seed}: {texts or 'nothing'}", file=sys.stderr, flush=True)
    often = ", ".join(f"{cause} {count}" for cause, count in firsts.most_common())
    return (
        f"| {planted.name} | {named} of {seeds} | {right} of {seeds} | {often} | "
        f"{spent_s / seeds:.1f} |"
    )


if __name__ == "__main__":
    main()
