"""Files are written beside their names, and names that were misspelt are known again."""

from __future__ import annotations

from pathlib import Path

import pytest

from recorder.errors import BadInput, OutputExists
from recorder.names import did_you_mean, nearest
from recorder.outputs import check_output, written_beside


def test_a_file_takes_its_name_when_it_is_complete(tmp_path: Path) -> None:
    target = tmp_path / "map.npz"
    target.write_text("old")
    with written_beside(target) as part:
        part.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def write_half(target: Path) -> None:
    with written_beside(target) as part:
        part.write_text("half")
        raise OSError("disk full")


def test_what_fails_leaves_the_old_file_and_nothing_beside_it(tmp_path: Path) -> None:
    target = tmp_path / "map.npz"
    target.write_text("old")
    with pytest.raises(OSError, match="disk full"):
        write_half(target)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_an_output_is_refused_where_it_exists_or_is_an_input(tmp_path: Path) -> None:
    there = tmp_path / "run.mcap"
    there.write_text("")
    check_output(tmp_path / "new.rrd", [there], force=False)
    check_output(there, force=True)
    with pytest.raises(OutputExists, match="--force"):
        check_output(there, force=False)
    (tmp_path / "link.mcap").symlink_to(there)
    with pytest.raises(BadInput, match="an input as well"):
        check_output(tmp_path / "link.mcap", [there], force=True)


def test_the_nearest_name_or_none() -> None:
    known = ("ping", "dirrs", "lidar")
    assert nearest("pimg", known) == "ping"
    assert nearest("zzz", known) is None
    assert did_you_mean("lidr", iter(known)) == "did you mean 'lidar'?"
    assert did_you_mean("zzz", iter(known)) == "there are ping, dirrs, lidar"
