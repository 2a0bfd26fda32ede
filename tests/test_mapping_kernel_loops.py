"""Loops that an earlier run compiled: loaded without numba, to the same bytes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mapping.kernels import loops, stored
from mapping.kernels.first_run import compiling_reported
from mapping.kernels.loops import Loop, kind_of

ROOT = Path(__file__).resolve().parent.parent
HOW_IT_GOES = """
import json, sys
import numpy as np
from mapping.kernels import loops
from mapping.kernels.first_run import compiling_reported

names = []
with compiling_reported(names.append):
    cells = np.zeros((3, 4), bool)
    cells[1, 1] = True
    far = loops.distances(cells)
    points = np.array([[0.0, 0.0], [1.0, 0.0], [5.0, 0.0]])
    offsets = loops.break_at_gaps(points, 2.0)
    points[:] = 0.0
print(json.dumps([names, "numba" in sys.modules, far.tolist(), offsets.tolist()]))
"""


def run(cache: Path, **environment: str) -> tuple[list[str], bool, list[list[float]], list[int]]:
    done = subprocess.run(
        [sys.executable, "-c", HOW_IT_GOES], cwd=ROOT, capture_output=True, text=True, check=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), **environment},
    )  # fmt: skip
    names, numba, far, offsets = json.loads(done.stdout)
    return names, numba, far, offsets


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="object code is kept as ELF")
def test_what_one_run_compiled_the_next_one_loads_without_numba(tmp_path: Path) -> None:
    names, with_numba, *first = run(tmp_path)
    assert names == ["distances", "break_at_gaps"]
    assert with_numba
    names, with_numba, *again = run(tmp_path)
    assert (names, with_numba) == ([], False)
    assert again == first
    assert first[1] == [0, 2, 3]
    files = sorted((tmp_path / "echogrid").iterdir())
    assert [file.name.partition("-")[0] for file in files] == [
        "mapping.line_kernels.chains.break_at_gaps", "mapping.line_kernels.spreading.distances",
    ]  # fmt: skip
    for file in files:  # what is damaged is made anew, and another setting makes other code
        file.write_bytes(file.read_bytes()[:-1000])
    names, _, *mended = run(tmp_path)
    assert mended == first
    assert names == []  # numba had kept its own
    names, with_numba, *plain = run(tmp_path, NUMBA_OPT="0")
    assert with_numba
    assert plain == first


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="object code is kept as ELF")
def test_code_of_another_processor_is_not_loaded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Neither by its name, where a folder has moved, nor where somebody gave it the right name."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    cells = np.zeros((3, 4), np.bool_)
    kinds = repr((kind_of(cells),))
    stored._machine.cache_clear()
    Loop("mapping.line_kernels.spreading", "distances")(cells)
    here = stored.file_of("mapping.line_kernels.spreading", "distances", kinds)
    assert here.exists()  # to load it in the process that compiled it would name everything twice
    for name, other in (
        ("get_host_cpu_name", lambda: "cortex-a72"),
        ("get_host_cpu_features", lambda: Features("+neon,-avx2")),
        ("get_process_triple", lambda: "aarch64-unknown-linux-gnu"),
    ):
        with monkeypatch.context() as patched:
            patched.setattr(f"llvmlite.binding.{name}", other)
            stored._machine.cache_clear()
            there = stored.file_of("mapping.line_kernels.spreading", "distances", kinds)
            assert there != here
            assert stored.load(there) is None
            there.write_bytes(here.read_bytes())
            assert stored.load(there) is None
    stored._machine.cache_clear()


class Features(str):
    """A processor's features, as LLVM reports them."""

    __slots__ = ()

    def flatten(self) -> str:
        return str(self)


def test_a_loop_is_told_apart_by_all_that_numba_tells_apart() -> None:
    whole = np.zeros((4, 6))
    frozen = whole.copy()
    frozen.flags.writeable = False
    kinds = {
        kind_of(each)
        for each in (whole, whole.T, whole[:, ::2], frozen, whole.astype(np.float32), whole[0], 1,
                     1.0, True, np.int32(1), (1, 2), (1, 2.0), None)
    }  # fmt: skip
    assert len(kinds) == 13
    assert kind_of(whole) == kind_of(whole[:2])


def test_a_file_that_is_not_one_is_no_loop(tmp_path: Path) -> None:
    file = tmp_path / "a.loop"
    assert stored.load(file) is None
    for content in (b"", b"{}", b"not json\n123", b'{"crc": 1}\n123'):
        file.write_bytes(content)
        assert stored.load(file) is None


def test_code_that_needs_what_is_not_there_is_left_alone() -> None:
    """LLVM would end the process."""
    code = elf_with_undefined("no_such_function_anywhere")
    assert list(stored._undefined(code)) == ["no_such_function_anywhere"]
    assert stored._linked(code, "f", "e", []) is None


def elf_with_undefined(name: str) -> bytes:
    """A 64-bit object file without code: a table of symbols, and their names."""
    names = b"\0" + name.encode() + b"\0"
    symbols = bytes(24) + stored._SYMBOL.pack(1, 0x10, 0, 0, 0, 0)
    head = bytearray(64)
    head[:6] = stored._ELF
    begin = len(head)
    after = begin + len(symbols)
    head[0x28:0x30] = (after + len(names)).to_bytes(8, "little")
    head[0x3A:0x3E] = (64).to_bytes(2, "little") + (3).to_bytes(2, "little")
    sections = [
        bytes(64),
        stored._SECTION.pack(0, 2, 0, 0, begin, len(symbols), 2, 1, 8, 24),
        stored._SECTION.pack(0, 3, 0, 0, after, len(names), 0, 0, 1, 0),
    ]
    return bytes(head) + symbols + names + b"".join(sections)


def test_every_loop_of_the_table_is_there() -> None:
    table = [each for each in vars(loops).values() if isinstance(each, Loop)]
    assert len(table) > 20
    for each in table:
        source = (ROOT / f"{each.module.replace('.', '/')}.py").read_text("utf-8")
        assert f"def {each.name}(" in source


def test_a_changed_source_is_another_loop(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    package = tmp_path / "mapping" / "kernels"
    package.mkdir(parents=True)
    monkeypatch.setattr(stored, "_ROOT", tmp_path)
    names = set()
    for text in ("a = 1", "a = 2"):
        (package / "near.py").write_text(text)
        stored._sources.cache_clear()
        names.add(stored.file_of("mapping.kernels.near", "f", "kinds").name)
    stored._sources.cache_clear()
    assert len(names) == 2


def test_whoever_asked_last_hears_what_is_compiled() -> None:
    from mapping.kernels.first_run import compiling

    outer: list[str] = []
    inner: list[str] = []
    with compiling_reported(outer.append):
        with compiling_reported(inner.append):
            compiling("a")
        compiling("b")
    compiling("c")
    assert (outer, inner) == (["b"], ["a"])
