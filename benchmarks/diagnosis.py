"""What ``diagnose`` names where a fault was planted, and where none was: a confusion table.

``python -m benchmarks.diagnosis run OUT.jsonl`` plants each fault in 20 simulated runs, in eight
rooms; with ``--recorded DIR`` in the recorded sessions of a folder. Each verdict is a line of
OUT.jsonl, and what stands there already is not run again: so it can be done in pieces (``--jobs 2``
at a time, ``--only late``, ``--seeds 100:120``). ``table OUT.jsonl`` prints the table as
docs/diagnose.md shows it, ``misses OUT.jsonl`` what was not named, or wrongly.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.planted import PLANTED, Fault, Planted, recorded, simulated
from mapping.config import load_config
from mapping.diagnosis.causes.interface import Suspect
from mapping.diagnosis.diagnosing import diagnose

DURATION_S = 280.0
Row = dict[str, Any]
BY_NAME = {each.name: each for each in PLANTED}


def main() -> None:
    """Run, or print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("run", "table", "misses"))
    parser.add_argument("results", type=Path, help="JSON lines, one a session")
    parser.add_argument("--seeds", default="100:120", help="FIRST:END")
    parser.add_argument("--quick", action="store_true", help="four seeds, runs of 200 s")
    parser.add_argument("--only", default="", help="faults whose names hold this (or|this)")
    parser.add_argument("--recorded", type=Path, help="plant into NAME_A.mcap, NAME_B.mcap there")
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    if asked.what == "run":
        _run(asked)
    elif asked.what == "table":
        print("\n".join(table(_rows(asked.results))))
    else:
        print("\n".join(misses(_rows(asked.results))))


def _rows(path: Path) -> list[Row]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def _run(asked: argparse.Namespace) -> None:
    first, end = map(int, asked.seeds.split(":"))
    seeds = range(first, first + 4 if asked.quick else end)
    duration_s = 200.0 if asked.quick else DURATION_S
    done = {(row["planted"], row["seed"]) for row in _rows(asked.results)}
    wanted = [
        (each.name, seed, duration_s, asked.recorded)
        for seed in seeds  # all faults by each: a run that is cut short is a fair table, too
        for each in PLANTED
        if any(part in each.name for part in asked.only.split("|"))
        and (each.recorded or asked.recorded is None)
        and (each.name, seed) not in done
    ]
    with asked.results.open("a") as out, ProcessPoolExecutor(asked.jobs) as pool:
        for count, row in enumerate(pool.map(_session, *zip(*wanted, strict=True)), 1):
            out.write(json.dumps(row) + "\n")
            out.flush()
            texts = "; ".join(s["text"] for s in row["suspects"]) or "nothing"
            print(f"{count}/{len(wanted)} {row['planted']}, seed {row['seed']}: {texts}",
                  file=sys.stderr, flush=True)  # fmt: skip


def _session(name: str, seed: int, duration_s: float, folder: Path | None) -> Row:
    """One session, as a line of the results."""
    planted = BY_NAME[name]
    if folder is None:
        session = simulated(planted, seed, duration_s)
    else:
        session = recorded(planted, seed, folder)
    began_s = time.process_time()
    found = diagnose(session, load_config())
    spent_s = time.process_time() - began_s
    keys = ("cause", "subject", "text", "value", "unit", "error", "cost", "sure", "seconds")
    suspects = [{key: getattr(each, key) for key in keys} for each in found.suspects]
    return {"planted": name, "seed": seed, "cpu_s": round(spent_s, 2), "suspects": suspects}


def verdict(planted: Planted, row: Row) -> tuple[bool, bool]:
    """Whether the right cause is named first (of the right sensor, with the right sign), and
    whether all amounts are right.

    Of two faults either may be named first, and both must be named; of none none.
    """
    suspects, faults = _suspects(row), planted.faults(row["seed"])
    if not faults:
        return not suspects, not suspects
    named = bool(suspects) and any(each.is_named(suspects[0]) for each in faults)
    named = named and all(any(map(each.is_named, suspects)) for each in faults)
    return named, named and all(any(map(each.is_right, suspects)) for each in faults)


def _suspects(row: Row) -> list[Suspect]:
    return [Suspect(evidence=(), **each) for each in row["suspects"]]


def table(rows: Iterable[Row]) -> Iterator[str]:
    """The confusion table, in Markdown; last how often the stated errors hold the truth."""
    rows = list(rows)
    yield "| planted | named first | and by the right amount | named first, how often | CPU, s |"
    yield "|---|---|---|---|---|"
    within: list[float] = []
    for planted in PLANTED:
        mine = [row for row in rows if row["planted"] == planted.name]
        if not mine:
            continue
        verdicts = [verdict(planted, row) for row in mine]
        named, right = (sum(each) for each in zip(*verdicts, strict=True))
        firsts = Counter(r["suspects"][0]["cause"] if r["suspects"] else "none" for r in mine)
        often = ", ".join(f"{cause} {count}" for cause, count in firsts.most_common())
        cpu_s = sum(row["cpu_s"] for row in mine) / len(mine)
        yield f"| {planted.name} | {named} of {len(mine)} | {right} | {often} | {cpu_s:.1f} |"
        within += [off for row in mine for off in _errors_off(planted.faults(row["seed"]), row)]
    if within:
        shares = [sum(off <= k for off in within) / len(within) for k in (1.0, 2.0)]
        yield ""
        yield (
            f"Of {len(within)} amounts with a stated error {shares[0]:.0%} lie within one of it, "
            f"{shares[1]:.0%} within two."
        )


def _errors_off(faults: Iterable[Fault], row: Row) -> Iterator[float]:
    """By how many of the stated errors the amounts that were named are wrong."""
    for fault in faults:
        for suspect in _suspects(row):
            if fault.is_named(suspect) and suspect.error:
                yield abs(fault.excess(suspect) - fault.planted) / suspect.error


def misses(rows: Iterable[Row]) -> Iterator[str]:
    """Each session in which something else was named, or by another amount."""
    for row in rows:
        planted = BY_NAME[row["planted"]]
        named, right = verdict(planted, row)
        if not right:
            texts = "; ".join(f"{s['text']} ({s['cost']:.3f})" for s in row["suspects"])
            wanted = ", ".join(
                f"{f.kind} {f.sensor} {f.amount:.3f}" for f in planted.faults(row["seed"])
            )
            what = "amount" if named else "name"
            yield f"{what}: {wanted or 'none'}, seed {row['seed']}: {texts or 'nothing'}"


if __name__ == "__main__":
    main()
