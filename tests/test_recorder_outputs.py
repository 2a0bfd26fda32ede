"""Files are written beside their names, and names that were misspelt are known again."""

from __future__ import annotations

import os
import resource
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from recorder.errors import BadInput, OutputExists
from recorder.names import did_you_mean, nearest
from recorder.outputs import check_output, check_room, written_beside
from recorder.session import Limits, PartedWriter, SessionWriter


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


Writer = Callable[[Path], AbstractContextManager[object]]


@contextmanager
def exporting(target: Path) -> Iterator[object]:
    """As `--export` and `diff -o` write."""
    with written_beside(target) as part:
        part.write_bytes(b"whole")
        yield part


@contextmanager
def recording(target: Path) -> Iterator[object]:
    """As `record` writes: under its own name from the first byte."""
    with PartedWriter(target, Limits(min_free_mb=0.0), force=True) as session:
        yield session


@contextmanager
def simulating(target: Path) -> Iterator[object]:
    """As `simulate` and `import` write."""
    with SessionWriter(target, force=True) as session:
        yield session


WRITERS: tuple[Writer, ...] = (exporting, recording, simulating)
NAMES = ("run.mcap", "é" * 120, "n" * 255, ".hidden", "with space.mcap")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("second", WRITERS)
@pytest.mark.parametrize("first", WRITERS)
def test_of_two_writers_the_second_is_refused_and_the_first_is_whole(
    tmp_path: Path, first: Writer, second: Writer, name: str
) -> None:
    target = tmp_path / name
    with (
        first(target),
        pytest.raises(BadInput, match="another run is writing it"),
        second(target),
    ):
        pass
    assert target.stat().st_size > 0
    assert list(tmp_path.iterdir()) == [target]
    with second(target):  # the lock has ended with the first
        pass
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("writer", WRITERS)
def test_other_peoples_files_and_links_of_likely_names_stay_as_they_are(
    tmp_path: Path, writer: Writer
) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine")
    (tmp_path / "run.mcap.part").symlink_to(precious)
    (tmp_path / "run.mcap.0123456789.part").write_text("what a killed run left")
    (tmp_path / ".run.mcap.part").write_text("mine")
    before = {each: each.read_text() for each in tmp_path.iterdir()}
    with writer(tmp_path / "run.mcap"):
        private = set(tmp_path.iterdir()) - set(before) - {tmp_path / "run.mcap"}
        assert all(part.stat().st_mode & 0o077 == 0 for part in private)
    assert {each: each.read_text() for each in before} == before
    assert set(tmp_path.iterdir()) == {*before, tmp_path / "run.mcap"}


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
@pytest.mark.parametrize("writer", WRITERS)
def test_a_finished_file_has_the_permissions_of_any_new_file(
    tmp_path: Path, writer: Writer, umask: int
) -> None:
    before = os.umask(umask)
    try:
        with writer(tmp_path / "run.mcap"):
            pass
    finally:
        os.umask(before)
    assert (tmp_path / "run.mcap").stat().st_mode & 0o777 == 0o666 & ~umask


@pytest.mark.parametrize("writer", WRITERS)
def test_a_pipe_or_a_device_is_never_replaced(tmp_path: Path, writer: Writer) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "null").symlink_to("/dev/null")
    for name in ("pipe", "null"):
        with pytest.raises(BadInput, match="no regular file"), writer(tmp_path / name):
            pass
    assert (tmp_path / "pipe").is_fifo()
    assert (tmp_path / "null").is_char_device()


def test_of_many_that_begin_at_once_one_writes(tmp_path: Path) -> None:
    target = tmp_path / "run.mcap"
    ready, outcomes = threading.Barrier(8), list[str]()

    def run() -> None:
        ready.wait()
        try:
            with written_beside(target) as part:
                part.write_text("whole")
                outcomes.append("wrote")
                ready.wait()
        except BadInput:
            outcomes.append("refused")
            ready.wait()

    threads = [threading.Thread(target=run) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(outcomes) == ["refused"] * 7 + ["wrote"]
    assert list(tmp_path.iterdir()) == [target]
