"""Files are written beside their names, and names that were misspelt are known again."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from recorder.errors import BadInput, OutputExists
from recorder.names import did_you_mean, nearest
from recorder.outputs import check_output, check_room, written_beside


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


def test_a_file_that_may_not_become_so_large_is_refused_before_it_is_written(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.rrd.part"
    path.write_bytes(b"x" * 1000)
    check_room(path, 100_000)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        check_room(path, 49_000)
        with pytest.raises(BadInput, match=r"run\.rrd: a file may not become that large"):
            check_room(path, 49_001)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == [path]
    assert path.stat().st_size == 1000


def test_a_disk_without_room_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no space left on the disk of"):
        check_room(tmp_path / "run.rrd", 2**62)
