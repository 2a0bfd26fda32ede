"""A recording in parts, joined sessions, and disks that fill up."""

from __future__ import annotations

import errno
import math
import os
import resource
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import ROOT

from echogrid import main
from mapping.config import MappingConfig
from mapping.pipeline import build_maps
from recorder.errors import BadInput, OutputExists
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range, Record, Transform
from recorder.session import Limits, PartedWriter, Session, SessionWriter, read_session
from recorder.session.part_names import parts_beside

T_NS = 1_700_000_000_000_000_000
STEP_NS = 50_000_000
CALIBRATION = {"protocol": "echogrid", "sensors": {"ping": {"beam_width_deg": 38}}}
WALLS = b'{"type": "FeatureCollection", "features": []}'
MOUNT = Transform(T_NS, "base_link", "ping", SE2(0.044, 0.0, 0.0))
ROOMY = Limits(min_free_mb=0)


def drive(count: int, first: int = 0) -> Iterator[tuple[int, Message]]:
    """A robot that goes along a wall: a pose and a reading each 50 ms."""
    for i in range(first, first + count):
        t_ns = T_NS + i * STEP_NS
        yield t_ns, Pose(t_ns, SE2(0.01 * i, 1.0, 0.3 * math.sin(i / 9)))
        yield t_ns, Range(t_ns, "ping", 0.5 + 0.001 * i, 0.663, 0.02, 4.0, Radiation.ULTRASOUND)


def recorded(path: Path, limits: Limits, count: int) -> list[Path]:
    """A recording of ``count`` steps within limits; its files."""
    with PartedWriter(path, limits, metadata=CALIBRATION) as session:
        session.attach("truth.geojson", "application/geo+json", WALLS)
        session.write(MOUNT, log_ns=T_NS)
        for log_ns, message in drive(count):
            session.write(message, log_ns=log_ns)
            if isinstance(message, Range) and log_ns % (20 * STEP_NS) == 0:
                session.sync()
    return session.parts


def test_parts_by_time_join_to_what_one_file_holds(tmp_path: Path) -> None:
    [single] = recorded(tmp_path / "one.mcap", ROOMY, 120)
    parts = recorded(tmp_path / "run.mcap", Limits(split_s=2.0, min_free_mb=0), 120)
    assert [part.name for part in parts] == ["run.mcap", "run-2.mcap", "run-3.mcap"]
    whole, joined = read_session(single), read_session(*reversed(parts))
    assert joined.records == whole.records
    assert joined.damage == ()
    assert {k: joined.metadata[k] for k in CALIBRATION} == CALIBRATION
    assert joined.attachments == {"truth.geojson": WALLS}
    for part in parts:
        times = [r.message.t_ns for r in read_session(part).records if isinstance(r.message, Range)]
        assert max(times) - min(times) < 2e9


def test_parts_by_size_are_no_larger_than_asked(tmp_path: Path) -> None:
    parts = recorded(tmp_path / "run.mcap", Limits(split_mb=0.01, min_free_mb=0), 800)
    assert len(parts) >= 3
    for part in parts:
        assert part.stat().st_size < 10_000 + 10_000  # and the index at its end, with definitions
    assert len([r for r in read_session(*parts).records if isinstance(r.message, Range)]) == 800


def test_each_part_alone_is_mapped(tmp_path: Path) -> None:
    """Mounts, calibration and the pose before it are in each part: not one reading is dropped."""
    parts = recorded(tmp_path / "run.mcap", Limits(split_s=2.0, min_free_mb=0), 120)
    used = 0
    for part in parts:
        session = read_session(part)
        assert {k: session.metadata[k] for k in CALIBRATION} == CALIBRATION
        assert session.attachments == {"truth.geojson": WALLS}
        mounts = [r.message for r in session.records if isinstance(r.message, Transform)]
        assert mounts == [MOUNT]
        *_, finished = build_maps(session.messages(), MappingConfig())
        assert finished.dropped == {}
        used += finished.readings
    assert used == 120


def test_a_part_that_is_missing_is_reported(tmp_path: Path) -> None:
    parts = recorded(tmp_path / "run.mcap", Limits(split_s=2.0, min_free_mb=0), 120)
    joined = read_session(parts[0], parts[2])
    assert joined.damage == ("between parts 1 and 3 there are missing ones",)
    with pytest.raises(BadInput, match="are the same part"):
        read_session(parts[0], parts[1], parts[1])


def test_damage_of_a_part_is_reported_with_its_name(tmp_path: Path) -> None:
    parts = recorded(tmp_path / "run.mcap", Limits(split_s=2.0, min_free_mb=0), 120)
    parts[1].write_bytes(parts[1].read_bytes()[:-300])
    assert [reason.split(":")[0] for reason in read_session(*parts).damage] == ["run-2.mcap"]


def test_parts_of_an_earlier_recording_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    (tmp_path / "run-2.mcap").write_bytes(b"precious")
    assert parts_beside(path) == [tmp_path / "run-2.mcap"]
    with pytest.raises(OutputExists, match=r"run-2\.mcap"):
        PartedWriter(path, Limits(split_s=1.0, min_free_mb=0))
    assert not path.exists()
    with PartedWriter(path, Limits(split_s=2.0, min_free_mb=0), force=True) as session:
        for log_ns, message in drive(60):
            session.write(message, log_ns=log_ns)
    assert [part.name for part in session.parts] == ["run.mcap", "run-3.mcap"]
    assert (tmp_path / "run-2.mcap").read_bytes() == b"precious"
    assert len(read_session(*session.parts).records) == 120


def test_a_part_knows_the_names_of_the_others(tmp_path: Path) -> None:
    for name in ("run", "run-2", "run-10", "run-x", "run-2-2", "other", "run-1"):
        (tmp_path / f"{name}.mcap").touch()
    names = ["run.mcap", "run-2.mcap", "run-10.mcap"]
    for number, name in ((1, "run.mcap"), (2, "run-2.mcap"), (10, "run-10.mcap")):
        found = parts_beside(tmp_path / name, number)
        assert [path.name for path in found] == [other for other in names if other != name]
    # a recording that is itself called run-2 has parts of its own
    assert parts_beside(tmp_path / "run-2.mcap") == [tmp_path / "run-2-2.mcap"]


def test_info_of_a_part_names_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = recorded(tmp_path / "run.mcap", Limits(split_s=2.0, min_free_mb=0), 120)
    assert main(["info", *map(str, parts)]) == 0
    reported = [line.strip() for line in capsys.readouterr().out.splitlines() if "part" in line]
    assert reported == [
        "part 1 of a recording; other parts beside it: run-2.mcap, run-3.mcap",
        "part 2 of a recording; other parts beside it: run.mcap, run-3.mcap",
        "part 3 of a recording; other parts beside it: run.mcap, run-2.mcap",
    ]


def session_of(path: Path, messages: list[tuple[int, Message]]) -> Path:
    with SessionWriter(path) as session:
        for log_ns, message in messages:
            session.write(message, log_ns=log_ns)
    return path


def test_recordings_of_one_time_are_moved_apart(tmp_path: Path) -> None:
    """Two logs without a clock begin at 0: no reading may meet a pose of the other drive."""
    a = session_of(tmp_path / "a.mcap", list(drive(40)))
    b = session_of(tmp_path / "b.mcap", list(drive(40)))
    late = session_of(tmp_path / "late.mcap", list(drive(40, first=100_000)))
    joined = read_session(a, b, late)
    times = [r.message.t_ns for r in joined.records if isinstance(r.message, Range)]
    assert times == sorted(times)
    assert times[40] - times[39] == 60_000_000_000
    assert times[:40] == [T_NS + i * STEP_NS for i in range(40)]
    assert times[80:] == [T_NS + i * STEP_NS for i in range(100_000, 100_040)]
    assert joined.metadata["files"] == ["a.mcap", "b.mcap", "late.mcap"]
    assert [r.log_ns - r.message.t_ns for r in joined.records] == [0] * 240


def test_recordings_with_other_mounts_are_not_joined(tmp_path: Path) -> None:
    elsewhere = Transform(T_NS, "base_link", "ping", SE2(0.1, 0.0, 0.0))
    a = session_of(tmp_path / "a.mcap", [(T_NS, MOUNT), *drive(3)])
    b = session_of(tmp_path / "b.mcap", [(T_NS, elsewhere), *drive(3)])
    with pytest.raises(BadInput, match=r"b\.mcap mounts ping elsewhere"):
        read_session(a, b)


class Disk:
    """Room that a test sets, looked at by a clock that a test moves."""

    def __init__(self, free_mb: float) -> None:
        self.free_mb, self.now_s = free_mb, 0.0

    def free_bytes(self, _: Path) -> int:
        return round(self.free_mb * 1e6)

    def monotonic_s(self) -> float:
        return self.now_s


def test_it_stops_before_the_disk_is_full_and_all_is_readable(tmp_path: Path) -> None:
    path, disk = tmp_path / "run.mcap", Disk(free_mb=300.0)
    with PartedWriter(
        path, Limits(), free_bytes=disk.free_bytes, monotonic_s=disk.monotonic_s
    ) as session:
        written, reported = 0, None
        for log_ns, message in drive(100):
            disk.now_s += 0.05
            disk.free_mb -= 1.0
            try:
                session.write(message, log_ns=log_ns)
                written += 1
            except OSError as error:
                reported = reported or error
        assert reported is not None
        assert reported.errno == errno.ENOSPC
        assert "MB of the disk are free, 200 MB are to stay so" in reported.strerror
    assert 100 <= written <= 120  # it looks once a second, which is 20 messages here
    found = read_session(path)
    assert len(found.records) == written
    assert found.damage == ()


def test_it_does_not_begin_on_a_full_disk(tmp_path: Path) -> None:
    disk = Disk(free_mb=50.0)
    with pytest.raises(BadInput, match="only 50 MB of the disk are free"):
        PartedWriter(tmp_path / "run.mcap", Limits(), free_bytes=disk.free_bytes)
    with pytest.raises(BadInput, match="there is no folder"):
        PartedWriter(tmp_path / "nowhere" / "run.mcap", Limits())
    assert list(tmp_path.iterdir()) == []


FILL = textwrap.dedent("""
    import resource, sys
    from pathlib import Path
    from recorder.geometry import SE2
    from recorder.messages import Pose
    from recorder.session import Limits, PartedWriter
    path, most, sync_every = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    session = PartedWriter(path, Limits(min_free_mb=0), metadata={"a": 1})
    if most:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    written = synced = 0
    try:
        while written < 200_000:
            session.write(Pose(written, SE2(written * 0.37, -written / 7, 0.1)), log_ns=written)
            written += 1
            if written % sync_every == 0:
                session.sync()
                synced = written
    except OSError as error:
        print(error.strerror)
    session.close()
    print(written, synced)
""")


def filled(path: Path, most_bytes: int, sync_every: int, *before: str) -> tuple[str, int, int]:
    """The reason why a child that writes and writes has stopped; how much it wrote and synced."""
    run = subprocess.run(
        [*before, sys.executable, "-c", FILL, str(path), str(most_bytes), str(sync_every)],
        capture_output=True, text=True, timeout=300, check=False,
        # Python takes compiled modules that found no room for whole ones.
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    reason, counts = run.stdout.splitlines()
    written, synced = counts.split()
    return reason, int(written), int(synced)


def assert_prefix(path: Path, synced: int, written: int) -> Session:
    found = read_session(path)
    assert [r.message.t_ns for r in found.records] == list(range(len(found.records)))
    assert synced <= len(found.records) <= written
    assert found.metadata == {"a": 1}
    assert found.damage
    return found


def test_a_file_that_may_not_grow_keeps_all_that_was_synced(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    reason, written, synced = filled(path, 60_000, 200)
    assert reason == os.strerror(errno.EFBIG)
    assert 0 < synced < written
    assert_prefix(path, synced, written)


def can_mount() -> bool:
    """Whether this system lets us mount a file system in a namespace of our own."""
    tried = subprocess.run(
        ["unshare", "-rm", "mount", "-t", "tmpfs", "tmpfs", "/mnt"], capture_output=True,
        check=False,
    ) if os.path.exists("/usr/bin/unshare") else None  # fmt: skip
    return tried is not None and tried.returncode == 0


def test_a_real_file_system_that_is_full(tmp_path: Path) -> None:
    """A tmpfs of 200 kB where the system lets us have one; it is copied out before it goes."""
    if not can_mount():
        pytest.skip("no file system may be mounted here; the limit on a file's size stands in")
    disk, path = tmp_path / "disk", tmp_path / "run.mcap"
    disk.mkdir()
    shell = 'mount -t tmpfs -o size=200k tmpfs "$0" && "$@"; status=$?; cp "$0/run.mcap" "$0/.."'
    before = ("unshare", "-rm", "sh", "-c", f"{shell}; exit $status", str(disk))
    reason, written, synced = filled(disk / "run.mcap", 0, 200, *before)
    assert reason == os.strerror(errno.ENOSPC)
    assert 0 < synced < written
    assert path.stat().st_size > 150_000
    assert_prefix(path, synced, written)


def test_a_disk_that_fails_when_the_file_is_finished(tmp_path: Path) -> None:
    """Nothing was raised before: closing raises it, and what stands on the disk is readable."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    path = tmp_path / "run.mcap"
    session = SessionWriter(path, live=True)
    for number in range(50):
        session.write(Pose(number, SE2(number, 0.0, 0.0)), log_ns=number)
    session.sync()
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 10, hard))
    try:
        with pytest.raises(OSError, match=os.strerror(errno.EFBIG)):
            session.close()
        session.close()  # once is enough
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(read_session(path).records) == 50


def test_an_import_that_finds_no_room_leaves_no_half_file(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    session = SessionWriter(tmp_path / "run.mcap")
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        with pytest.raises(BadInput, match=rf"run\.mcap: {os.strerror(errno.EFBIG)}"), session:
            session.write(MOUNT, log_ns=T_NS)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "use",
    [lambda s: s.write(MOUNT, log_ns=T_NS), lambda s: s.sync(), lambda s: s.attach("", "", b"")],
)
def test_a_closed_session_takes_nothing(
    tmp_path: Path, use: Callable[[SessionWriter], None]
) -> None:
    session = SessionWriter(tmp_path / "run.mcap")
    session.close()
    with pytest.raises(ValueError, match="is closed"):
        use(session)


def test_records_of_a_single_file_are_untouched_by_joining(tmp_path: Path) -> None:
    path = session_of(tmp_path / "a.mcap", [(T_NS, MOUNT), *drive(5)])
    expected = [Record("/tf_static", T_NS, MOUNT)]
    assert list(read_session(path).records[:1]) == expected


@pytest.mark.parametrize("live", [True, False])
def test_a_disk_without_room_for_the_beginning_gets_no_file(tmp_path: Path, live: bool) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    path = tmp_path / "run.mcap"
    resource.setrlimit(resource.RLIMIT_FSIZE, (300, hard))
    try:
        with pytest.raises(BadInput, match=r"run\.mcap: a file may not become that large"):
            SessionWriter(path, live=live)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []
    SessionWriter(path, live=live).close()
    assert read_session(path).records == ()


@pytest.mark.parametrize("force", [True, False])
def test_a_folder_is_no_session(tmp_path: Path, force: bool) -> None:
    with pytest.raises(BadInput, match="it is a folder"):
        SessionWriter(tmp_path, force=force)
