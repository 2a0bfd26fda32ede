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


def test_a_bad_session_and_only_this_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text("utf-8")
    commands, shown = re.findall(r"^```\w*\n(.*?)^```", text, re.DOTALL | re.MULTILINE)[:2]
    codes = [main(shlex.split(line)[1:]) for line in commands.splitlines()]
    assert codes == [0, 1, 0, 0]  # 1: something was found
    printed = capsys.readouterr().out
    lines = {NUMBER.sub("#", line): line for line in reversed(printed.splitlines())}
    for line in shown.splitlines():
        assert line.strip() == "..." or NUMBER.sub("#", line) in lines
    for at, (truth, within) in enumerate([(8.0, 1.0), (3.0, 0.9), (100.0, 5.0)], 1):
        (head,) = re.findall(rf"^{at}\. \D*([\d.]+) \+- ", printed, re.MULTILINE)
        assert float(head) == pytest.approx(truth, abs=within)
    drawn = re.findall(r"^dirrs +grid +\d+ +[\d.]+ +(\d+)/", printed, re.MULTILINE)
    said = re.search(r"Of the walls (\d+) % were .* and (\d+) % are with", text)
    assert said is not None
    assert [float(each) for each in drawn] == pytest.approx([*map(float, said.groups())], abs=8.0)
    assert "<svg" in Path("bad.html").read_text("utf-8")
