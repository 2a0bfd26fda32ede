"""What ``diagnose`` names where a fault was planted, and where none was: a confusion table.

``python -m benchmarks.diagnosis run OUT.jsonl`` plants each fault in 20 simulated runs, in eight
rooms; with ``--recorded DIR`` in the recorded sessions of a folder. Each verdict is a line of
OUT.jsonl, and what stands there already is not run again: so it can be done in pieces (``--jobs 2``
at a time, ``--only late``, ``--seeds 100:120``). ``table SIMULATED.jsonl OTHER.jsonl`` prints the
table as docs/diagnose.md shows it, two columns a file, ``misses OUT.jsonl`` what was not named, or
wrongly.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.planted import (
    PLANTED,
    Fault,
    Planted,
    has_amount,
    recorded,
    recordings,
    simulated,
)
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
    parser.add_argument("results", type=Path, nargs="+", help="JSON lines, one a session")
    parser.add_argument("--seeds", default="100:120", help="FIRST:END")
    parser.add_argument("--quick", action="store_true", help="four seeds, runs of 200 s")
    parser.add_argument("--only", default="", help="faults whose names hold this (or|this)")
    parser.add_argument("--recorded", type=Path, help="plant into NAME_A.mcap, NAME_B.mcap there")
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    if asked.what == "run":
        if len(asked.results) > 1 or (asked.recorded and not recordings(asked.recorded)):
            parser.error("one file to write, and recordings NAME_A.mcap or NAME_B.mcap")
        _run(asked)
    elif asked.what == "table":
        files = {path.stem: _rows(path) for path in asked.results}
        if len(files) < len(asked.results) or not all(files.values()):
            parser.error("each file needs rows, and a name of its own")
        print("\n".join(table(files)))
    else:
        print("\n".join(misses(row for path in asked.results for row in _rows(path))))


def _rows(path: Path) -> list[Row]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def _run(asked: argparse.Namespace) -> None:
    first, end = map(int, asked.seeds.split(":"))
    seeds = range(first, first + 4 if asked.quick else end)
    duration_s = 200.0 if asked.quick else DURATION_S
    (results,) = asked.results
    done = {(row["planted"], row["seed"]) for row in _rows(results)}
    cases: dict[Any, tuple[str, int]] = {}
    for seed in seeds:  # all faults by each: a run that is cut short is a fair table, too
        for each in PLANTED:
            if each.recorded or asked.recorded is None:
                # The same fault in the same recording is the same case, whatever the seed.
                session = seed % len(recordings(asked.recorded)) if asked.recorded else seed
                cases.setdefault((each.name, session, each.faults(seed)), (each.name, seed))
    wanted = [
        (name, seed, duration_s, asked.recorded)
        for name, seed in cases.values()
        if any(part in name for part in asked.only.split("|")) and (name, seed) not in done
    ]
    with results.open("a") as out, ProcessPoolExecutor(asked.jobs) as pool:
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


def table(files: Mapping[str, list[Row]]) -> Iterator[str]:
    """The confusion table, in Markdown: of each file how often the right cause came first and how
    often all amounts were right ("-" where none is checked), of the first what came first instead;
    then how often the stated errors hold the truth."""
    first = next(iter(files))
    heads = [f"{name}: first | right" for name in files]
    yield f"| planted | {' | '.join(heads)} | named first ({first}) |"
    yield "|---" * (2 + 2 * len(files)) + "|"
    for planted in PLANTED:
        mine = {k: [r for r in rows if r["planted"] == planted.name] for k, rows in files.items()}
        if any(mine.values()):
            counts = " | ".join(_counts(planted, rows) for rows in mine.values())
            causes = (r["suspects"][0]["cause"] if r["suspects"] else "none" for r in mine[first])
            often = ", ".join(f"{cause} {count}" for cause, count in Counter(causes).most_common())
            yield f"| {planted.name} | {counts} | {often} |"
    for name, rows in files.items():
        within = [e for r in rows for e in _errors_off(BY_NAME[r["planted"]].faults(r["seed"]), r)]
        cpu_s = [row["cpu_s"] for row in rows]
        yield ""
        yield f"{name}: {np.mean(cpu_s):.1f} s of CPU a session, {max(cpu_s):.0f} at most."
        if within:
            one, two = (np.mean(np.array(within) <= errors) for errors in (1.0, 2.0))
            yield (
                f"{name}: of {len(within)} amounts with a stated error {one:.0%} lie within one of "
                f"it, {two:.0%} within two."
            )


def _counts(planted: Planted, rows: Sequence[Row]) -> str:
    """How often the right cause came first, and how often all amounts were right."""
    if not rows:
        return "- | -"
    named, right = map(sum, zip(*(verdict(planted, row) for row in rows), strict=True))
    checked = any(map(has_amount, planted.faults(rows[0]["seed"])))
    return f"{named} of {len(rows)} | {right if checked else '-'}"


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
