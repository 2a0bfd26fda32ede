"""How much of what could go wrong in `mapping/` do the regression tests alone find?

Changes single places of the code at random (cosmic-ray makes the mutants: a + for a -, a < for a
<=, a number one larger, a loop that never runs ...) and runs ``tests/test_regression*.py`` on each,
in copies of the tree. Prints how many were caught, and the survivors with what was changed.

    python benchmarks/mutation.py --count 60 --seed 1

Left out are only places inside annotations that Python never evaluates: no test can see those.
"""

from __future__ import annotations

import argparse
import ast
import multiprocessing
import os
import random
import shlex
import shutil
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
COPIED = ("recorder", "mapping", "replay", "tests", "logs", "echogrid.py", "pyproject.toml")
COMPILED = ("mapping/kernels/", "mapping/line_kernels/")
EVALUATED = ("mapping/config.py",)  # pydantic reads the annotations of its models


@dataclass(frozen=True, slots=True)
class Mutant:
    """One place, and what is done to it."""

    module: str
    operator: str
    arguments: tuple[tuple[str, object], ...]
    occurrence: int
    line: int

    @property
    def place(self) -> str:
        return f"{self.module}:{self.line}"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mutant."""

    mutant: Mutant
    outcome: str  # caught, timed out, survived, not run
    by: str
    diff: str
    seconds: float


def copy_tree(into: Path) -> None:
    """The parts of the tree that the regression tests need."""
    skip = shutil.ignore_patterns("__pycache__", ".*")
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, into / name, ignore=skip)
        else:
            shutil.copy(source, into / name)


def mutants_of(tree: Path) -> tuple[list[Mutant], int]:
    """Every mutant that cosmic-ray would make of ``mapping/``, and how many were left out."""
    from cosmic_ray.commands.init import init
    from cosmic_ray.work_db import WorkDB

    os.chdir(tree)
    modules = [p.relative_to(tree) for p in sorted((tree / "mapping").rglob("*.py"))]
    found, left_out = [], 0
    hidden = {str(module): unevaluated(module) for module in modules}
    with tempfile.TemporaryDirectory() as folder:
        database = WorkDB(str(Path(folder) / "work.sqlite"), WorkDB.Mode.create)
        init(modules, database, {})
        for item in database.work_items:
            (spec,) = item.mutations
            module = Path(spec.module_path).as_posix()
            if any(low <= tuple(spec.start_pos) < high for low, high in hidden[module]):
                left_out += 1
                continue
            arguments = tuple(sorted(spec.operator_args.items()))
            found.append(
                Mutant(module, spec.operator_name, arguments, spec.occurrence, spec.start_pos[0])
            )
        database.close()
    return sorted(found, key=lambda m: (m.module, m.operator, m.occurrence)), left_out


def unevaluated(module: Path) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Where the annotations of a file stand that are never evaluated, as (line, column) spans."""
    text = module.read_text("utf-8")
    if module.as_posix() in EVALUATED or "from __future__ import annotations" not in text:
        return []
    nodes: list[ast.expr | None] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            nodes.append(node.returns)
        elif isinstance(node, ast.arg | ast.AnnAssign):
            nodes.append(node.annotation)
    return [
        ((n.lineno, n.col_offset), (n.end_lineno or 0, n.end_col_offset or 0)) for n in nodes if n
    ]


def regression_command(tree: Path) -> str:
    """The regression tests alone, up to the first failure."""
    files = sorted(
        p.relative_to(tree).as_posix() for p in (tree / "tests").glob("test_regression*")
    )
    quiet = "-x -q --no-header --tb=line -p no:cacheprovider -p no:xdist -p no:randomly"
    return f"{shlex.quote(sys.executable)} -m pytest {quiet} {' '.join(files)}"


def prepare(tree: Path) -> None:
    """This process, and the tests that it starts, see the copy and nothing else."""
    os.chdir(tree)
    os.environ["PYTHONPATH"] = str(tree)
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"  # a stale one could hide a mutant
    os.environ["NUMBA_CACHE_DIR"] = str(tree / "compiled")
    os.environ.pop("UPDATE_GOLDEN", None)
    os.nice(5)


def baseline(tree: Path) -> float:
    """Seconds that the unchanged code takes with its kernels compiled; it must pass."""
    from cosmic_ray.testing import run_tests

    prepare(tree)
    for _ in range(2):  # the first one compiles
        began = time.perf_counter()
        outcome, output = run_tests(regression_command(tree), 1800)
        if outcome.value != "survived":
            raise SystemExit(f"the regression tests fail without any mutant:\n{output[-3000:]}")
    return time.perf_counter() - began


def judge(task: tuple[Path, Mutant, float]) -> Verdict:
    """Run the regression tests on one mutant, in the copy that belongs to this process."""
    from cosmic_ray.mutating import mutate_and_test
    from cosmic_ray.work_item import MutationSpec

    trees, mutant, limit_s = task
    tree = trees / f"tree{multiprocessing.current_process()._identity[-1] % 1000}"
    if not tree.exists():
        shutil.copytree(trees / "tree", tree)
        prepare(tree)
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as fresh:
        if mutant.module.startswith(COMPILED):
            # what calls a changed kernel would be taken from the cache unchanged
            os.environ["NUMBA_CACHE_DIR"], limit_s = fresh, limit_s + 300.0
        else:
            os.environ["NUMBA_CACHE_DIR"] = str(tree / "compiled")
        spec = MutationSpec(
            module_path=Path(mutant.module), operator_name=mutant.operator,
            operator_args=dict(mutant.arguments), occurrence=mutant.occurrence,
            start_pos=(1, 0), end_pos=(1, 1),
        )  # fmt: skip
        result = mutate_and_test([spec], regression_command(tree), limit_s)
    output = result.output or ""
    outcome = "not run"
    if result.test_outcome is not None:
        outcome = {"killed": "caught", "survived": "survived"}.get(
            result.test_outcome.value, "not run"
        )
    if outcome == "caught" and output.strip() == "timeout":
        outcome = "timed out"
    failed = [line for line in output.splitlines() if line.startswith(("FAILED", "ERROR"))]
    by = failed[0].split(" ", 1)[1].split(" - ")[0] if failed else outcome
    return Verdict(mutant, outcome, by, result.diff or "", time.perf_counter() - began)


def changed_lines(diff: str) -> list[str]:
    """The lines of a diff that say what was changed."""
    return [
        line.rstrip() for line in diff.splitlines()
        if line[:1] in "+-" and not line.startswith(("+++", "---"))
    ]  # fmt: skip


def report(verdicts: list[Verdict], drawn_from: int, left_out: int, seed: int) -> str:
    """The table in Markdown."""
    counts = Counter(v.outcome for v in verdicts)
    caught = counts["caught"] + counts["timed out"]
    lines = [
        f"{len(verdicts)} mutants, seed {seed}, of {drawn_from} ({left_out} in annotations that "
        "are never evaluated left out):",
        f"{caught} caught ({counts['timed out']} of them by the time limit), "
        f"{counts['survived']} survived, {counts['not run']} could not be run: "
        f"{100.0 * caught / max(len(verdicts), 1):.1f} % caught.",
        "", "| # | place | operator | outcome | first seen by |", "| --- | --- | --- | --- | --- |",
    ]  # fmt: skip
    for number, v in enumerate(verdicts, 1):
        operator = v.mutant.operator.removeprefix("core/")
        by = v.by.removeprefix("tests/").replace("|", "\\|")
        lines.append(f"| {number} | `{v.mutant.place}` | {operator} | {v.outcome} | {by} |")
    for number, v in enumerate(verdicts, 1):
        if v.outcome not in ("caught", "timed out"):
            lines += ["", f"Mutant {number}, {v.mutant.place}: {v.outcome}", "", "```diff"]
            lines += [*changed_lines(v.diff), "```"]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Sample, judge, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", help="only mutants of files whose name holds this")
    parser.add_argument("-o", "--output", type=Path, help="the table as Markdown")
    asked = parser.parse_args()
    output = asked.output.resolve() if asked.output else None
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        trees = Path(folder)
        tree = trees / "tree"
        tree.mkdir()
        copy_tree(tree)
        everything, left_out = mutants_of(tree)
        if asked.only:
            everything = [m for m in everything if asked.only in m.module]
        sample = random.Random(asked.seed).sample(everything, min(asked.count, len(everything)))
        # A process of its own: what is imported and set there stays there.
        context = multiprocessing.get_context("spawn")
        with context.Pool(1) as one:
            seconds = one.apply(baseline, (tree,))
        print(f"{len(everything)} mutants; the tests take {seconds:.0f} s", flush=True)
        limit_s = 4.0 * seconds + 30.0
        verdicts = []
        with context.Pool(asked.jobs) as pool:
            tasks = [(trees, mutant, limit_s) for mutant in sample]
            for v in pool.imap(judge, tasks, chunksize=1):
                verdicts.append(v)
                what = " / ".join(changed_lines(v.diff)) if v.outcome == "survived" else v.by
                print(f"{len(verdicts):3} {v.outcome:9} {v.seconds:4.0f} s "
                      f"{v.mutant.place} {v.mutant.operator} {what}", flush=True)  # fmt: skip
    text = report(verdicts, len(everything), left_out, asked.seed)
    print(text)
    if output:
        output.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
