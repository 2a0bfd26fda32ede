"""What docs/diagnose.md shows first is what its commands print, but for last digits: sums of the
search may differ between processors."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from conftest import ROOT

from echogrid import main

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
PAGE = ROOT / "docs" / "diagnose.md"


def alike(shown: str, printed: str) -> bool:
    """The same words, and nearly the same numbers."""
    if NUMBER.sub("#", shown) != NUMBER.sub("#", printed):
        return False
    said, found = ([float(each) for each in NUMBER.findall(line)] for line in (shown, printed))
    return found == pytest.approx(said, rel=0.05, abs=0.006)


def test_a_bad_session_and_only_this_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text("utf-8")
    commands, shown = re.findall(r"^```\w*\n(.*?)^```", text, re.DOTALL | re.MULTILINE)[:2]
    codes = [main(shlex.split(line)[1:]) for line in commands.splitlines()]
    assert codes == [0, 1, 0, 0]  # 1: something was found
    printed = capsys.readouterr().out
    lines = printed.splitlines()
    for line in shown.splitlines():
        assert line.strip() == "..." or any(alike(line, each) for each in lines), line
    for at, (truth, within) in enumerate([(8.0, 1.0), (3.0, 0.9), (100.0, 5.0)], 1):
        (found,) = re.findall(rf"^{at}\. \D*([\d.]+) \+- ", printed, re.MULTILINE)
        assert float(found) == pytest.approx(truth, abs=within)
    drawn = re.findall(r"^dirrs +grid +\d+ +[\d.]+ +(\d+)/", printed, re.MULTILINE)
    said = re.search(r"saw (\d+) % were drawn .* and (\d+) % are with", text)
    assert said is not None
    assert [float(each) for each in drawn] == pytest.approx([*map(float, said.groups())], abs=3.0)
    assert "<svg" in Path("bad.html").read_text("utf-8")
