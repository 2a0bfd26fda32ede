"""``record`` as a user meets it: sources, protocols, options, keys, signals and what is kept."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from fake_links import PtyDevice, Rfc2217Server

from echogrid import main
from recorder.geometry import SE2
from recorder.messages import Diagnostics, Odometry, Pose, Radiation, Range, RawLine, Transform
from recorder.protocols.echogrid import encode
from recorder.protocols.reports import RangeReport, Report, WheelReport
from recorder.session import Session, read_session

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

PATIENCE_S = 60.0


def of(session: Session, kind: type) -> list:
    return [message for message in session.messages() if isinstance(message, kind)]


@contextmanager
def again_and_again(act: Callable[[int], object], period_s: float = 0.02) -> Iterator[None]:
    """Calls ``act`` with 0, 1, 2 and so on, until it is left."""
    done = threading.Event()

    def run() -> None:
        count = 0
        while not done.wait(period_s):
            act(count)
            count += 1

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


@contextmanager
def sending(device: PtyDevice, send: Callable[[int], bytes]) -> Iterator[None]:
    """A device that sends something 50 times a second."""
    device.plug()
    with again_and_again(lambda count: device.write(send(count))):
        yield
    device.unplug()


def lines(*reports: Report) -> Callable[[int], bytes]:
    def send(count: int) -> bytes:
        n = len(reports)
        return b"".join(
            encode(report, (n * count + i) % 2**16, 20 * count) for i, report in enumerate(reports)
        )

    return send


@pytest.mark.parametrize("protocol", ["echogrid", "rbc", "csv"])
def test_the_simulated_robot_in_each_protocol(protocol: str, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    arguments = ["record", "sim:room", "-o", str(path), "--protocol", protocol]
    assert main([*arguments, "--duration", "3", "--quiet"]) in (0, 1)
    session = read_session(path)
    assert {reading.sensor for reading in of(session, Range)} == {"ping", "dirrs"}
    assert of(session, Pose)
    assert {mount.child for mount in of(session, Transform)} == {"ping", "dirrs"}
    assert bool(of(session, Odometry)) == (protocol == "echogrid")
    assert session.metadata["protocol"] == protocol
    assert session.metadata["source"] == "sim:room"
    assert ("unchecked" in session.metadata) == (protocol != "echogrid")
    assert "truth.geojson" in session.attachments
    assert session.damage == ()


def test_info_reports_what_is_unchecked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.mcap"
    device = PtyDevice(tmp_path / "robot")
    options = ["--protocol", "csv", "--columns", "t_ms,ping:cm", "--duration", "1", "--quiet"]
    with sending(device, lambda count: b"%d,%d\r\n" % (20 * count, 50)):
        assert main(["record", str(device.path), "-o", str(path), *options]) == 0
    assert main(["info", str(path)]) == 0
    assert "csv has no checksum" in capsys.readouterr().out
    assert {reading.range_m for reading in of(read_session(path), Range)} == {0.5}


def test_sensors_of_other_names(tmp_path: Path) -> None:
    path, device = tmp_path / "run.mcap", PtyDevice(tmp_path / "robot")
    send = lines(RangeReport("left", 1.0), RangeReport("front", 0.5), RangeReport("other", 0.5))
    arguments = ["record", str(device.path), "-o", str(path), "--duration", "1", "--quiet"]
    with sending(device, send):
        main([*arguments, "--sensor", "left=dirrs", "--sensor", "front=15,0.05,1.5,ir"])
    session = read_session(path)
    seen = {r.sensor: (r.max_range_m, r.radiation) for r in of(session, Range)}
    assert seen == {
        "left": (0.8, Radiation.INFRARED),
        "front": (1.5, Radiation.INFRARED),
        "other": (4.0, Radiation.ULTRASOUND),
    }
    sensors = session.metadata["sensors"]
    assert isinstance(sensors, dict)
    assert sensors["front"]["beam_width_deg"] == 15.0
    assert int(of(session, Diagnostics)[-1].counters["unknown_sensors"]) == 1


def test_wheels_and_mounts_and_a_tracker_over_udp(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    path, device = tmp_path / "run.mcap", PtyDevice(tmp_path / "robot")

    def send(count: int) -> bytes:
        reports = (RangeReport("ping", 1.0), WheelReport(100 * count, 100 * count))
        return lines(*reports)(count)

    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def track(count: int) -> None:
        pose = {"t_s": time.time(), "x": 300, "y": 600, "heading_deg": 90}
        sender.sendto(json.dumps(pose).encode(), ("127.0.0.1", port))

    arguments = [
        "record", str(device.path), "-o", str(path), "--duration", "2", "--quiet",
        "--tracker", f"udp://127.0.0.1:{port}", "--tracker-px-per-m", "300",
        "--wheels", "0.05,0.2,1000", "--mount", "ping=0.044,0,0",
        "--mount", "dirrs@head=-0.03,0.01,90",
    ]  # fmt: skip
    with sending(device, send), again_and_again(track):
        main(arguments)
    sender.close()
    session = read_session(path)
    poses = [pose.world_from_base for pose in of(session, Pose)]
    assert poses
    assert {(pose.x_m, pose.y_m, round(pose.heading_rad, 9)) for pose in poses} == {
        (1.0, 2.0, round(math.pi / 2, 9))
    }
    assert of(session, Transform)[0].parent_from_child == SE2(0.044, 0.0, 0.0)
    dirrs = of(session, Transform)[1]
    assert (dirrs.parent, dirrs.child) == ("head", "dirrs")
    assert dirrs.parent_from_child.heading_rad == pytest.approx(math.pi / 2)
    steps_m = [odometry.odom_from_base.x_m for odometry in of(session, Odometry)]
    assert steps_m[1] - steps_m[0] == pytest.approx(0.1 * 2 * math.pi * 0.05)  # a tenth of a turn
    logged_ns = [r.log_ns for r in session.records if isinstance(r.message, Range | Pose)]
    latest_ns, backwards_ns = 0, 0
    for log_ns in logged_ns:
        backwards_ns = max(backwards_ns, latest_ns - log_ns)
        latest_ns = max(latest_ns, log_ns)
    assert backwards_ns < 1_000_000_000, "both links are written as they come"
    kinds = {type(r.message) for r in session.records[len(session.records) // 2 :]}
    assert {Range, Pose, Odometry, RawLine} <= kinds


def test_a_port_over_the_network(tmp_path: Path) -> None:
    server, path = Rfc2217Server(), tmp_path / "run.mcap"
    line_of = lines(RangeReport("ping", 0.5))

    def send(count: int) -> None:
        server.to_send = line_of(count)

    with again_and_again(send, 0.2):
        url = f"rfc2217://127.0.0.1:{server.port}"
        main(["record", url, "-o", str(path), "--duration", "3", "--quiet"])
    assert {reading.range_m for reading in of(read_session(path), Range)} == {0.5}


def test_a_protocol_of_ones_own(tmp_path: Path) -> None:
    plugin = tmp_path / "mine.py"
    plugin.write_text(
        "from recorder.protocols import LineProtocol\n"
        "from recorder.protocols.reports import RangeReport\n\n"
        "class Mine(LineProtocol):\n"
        '    name = "mine"\n\n'
        "    def read(self, line):\n"
        "        sensor, mm = line.split()\n"
        "        return RangeReport(sensor, int(mm) / 1000)\n"
    )
    path, device = tmp_path / "run.mcap", PtyDevice(tmp_path / "robot")
    with sending(device, lambda _: b"ping 523\r\n"):
        arguments = ["record", str(device.path), "-o", str(path), "--protocol", str(plugin)]
        assert main([*arguments, "--duration", "1", "--quiet"]) == 0
    session = read_session(path)
    assert session.metadata["protocol"] == "mine"
    assert {reading.range_m for reading in of(session, Range)} == {0.523}


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--protocol", "ecogrid"], "did you mean 'echogrid'"),
        (["--protocol", "csv"], "csv needs its columns named"),
        (["--columns", "ping:cm"], "for csv"),
        (["--wheels", "1,2"], "--wheels RADIUS_M,TRACK_M,COUNTS[,RANGE] is wanted"),
        (["--wheels", "1,2,0"], "above zero"),
        (["--wheels", "1,2,nan"], "is wanted"),
        (["--mount", "ping"], "--mount NAME=X_M,Y_M,DEG is wanted"),
        (["--mount", "ping=1,2"], "--mount ping=1,2: '1,2' is not three numbers; --mount NAME="),
        (["--mount", "pi/ng=1,2,3"], "--mount pi/ng=1,2,3: 'pi/ng' is no name"),
        (["--mount", "ping@1=1,2,3"], "'1' is no name"),
        (["--duration", "abc"], "'abc' is not a valid number"),
        (["--duration", "nan"], "'nan' is not a number that can be used"),
        (["--duration", "inf"], "inf is not in the range"),
        (["--duration", "1e300"], "1e+300 is not in the range"),
        (["--split-mb", "inf"], "'inf' is not a number that can be used"),
        (["--sensor", "left"], "--sensor NAME=KIND or NAME=BEAM_DEG,MIN_M,MAX_M[,ir]"),
        (["--sensor", "left=pong"], "no kind 'pong'; did you mean 'ping'?"),
        (["--sensor", "left=15,2,1"], "no sensor is like that"),
        (["--baud", "-1"], "makes no sense"),
        ([], "there is no such device"),
    ],
)
def test_what_cannot_be_is_reported_in_one_line(
    options: list[str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    assert main(["record", str(tmp_path / "robot"), "-o", str(path), *options]) == 2
    captured = capsys.readouterr()
    assert reason in captured.err
    assert len(captured.err.splitlines()) == 1
    assert not path.exists()


def test_what_a_replayed_session_had_lost_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, cut, again = (tmp_path / name for name in ("whole.mcap", "cut.mcap", "again.mcap"))
    assert main(["simulate", "room", "-o", str(whole), "--duration", "2", "--quiet"]) == 0
    cut.write_bytes(whole.read_bytes()[:-100])
    arguments = ["-o", str(again), "--duration", "1", "--quiet"]
    assert main(["record", f"replay:{cut}", *arguments]) == 1
    assert capsys.readouterr().err.startswith(f"echogrid: {cut}: ")
    assert of(read_session(again), Range)
    assert main(["record", f"replay:{whole}", *arguments, "--force"]) == 0
    assert capsys.readouterr().err == ""


def test_without_a_place_to_show_anything_it_records_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a service may start it, with standard error closed."""
    monkeypatch.setattr(sys, "stderr", None)
    path = tmp_path / "run.mcap"
    assert main(["record", "sim:room", "-o", str(path), "--duration", "1.5"]) == 0
    assert of(read_session(path), Range)


def test_a_full_disk_behind_standard_output_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class FullDisk(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "run.mcap"
    assert main(["simulate", "room", "-o", str(path), "--duration", "1", "--quiet"]) == 0
    monkeypatch.setattr(sys, "stdout", FullDisk())
    assert main(["info", str(path)]) == 2
    assert capsys.readouterr().err == f"echogrid: {os.strerror(errno.ENOSPC)}\n"


def test_a_folder_is_no_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run.mcap"
    folder.mkdir()
    for command in (["simulate", "room"], ["record", "sim:room", "--duration", "1"]):
        assert main([*command, "-o", str(folder), "--force", "--quiet"]) == 2
        assert capsys.readouterr().err == f"echogrid: {folder}: it is a folder\n"
    assert list(tmp_path.iterdir()) == [folder]


def test_another_protocol_than_the_robots_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, device = tmp_path / "run.mcap", PtyDevice(tmp_path / "robot")
    with sending(device, lambda count: b"%d,52\r\n" % count):
        arguments = ["record", str(device.path), "-o", str(path), "--duration", "1", "--quiet"]
        assert main(arguments) == 1
    assert "nothing of what came was understood" in capsys.readouterr().err
    assert "".join(raw.text for raw in of(read_session(path), RawLine)).count(",52\r\n") > 5


def test_what_a_simulated_robot_brings_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(tmp_path / "run.mcap")
    assert main(["record", "sim:room", "-o", path, "--wheels", "1,1,1"]) == 2
    assert "brings its own" in capsys.readouterr().err


class Program:
    """``record`` of the simulated robot in a process of its own, and what it prints."""

    def __init__(self, path: Path, *, terminal: bool) -> None:
        self._ours, theirs = os.openpty() if terminal else os.pipe()
        command = [sys.executable, "-m", "echogrid", "record", "sim:room", "-o", str(path)]
        self._process = subprocess.Popen(
            command, stdin=theirs if terminal else subprocess.DEVNULL, stderr=theirs,
            stdout=subprocess.DEVNULL, cwd=Path(__file__).parent.parent, start_new_session=True,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "100"},
        )  # fmt: skip
        os.close(theirs)

    def wait_for(self, *words: str, without: str = "\0") -> None:
        """Until all words stand in what is printed from now on, piece by piece."""
        give_up_s, printed = time.monotonic() + PATIENCE_S, ""
        while not (all(word in printed for word in words) and without not in printed):
            assert time.monotonic() < give_up_s, printed
            if select.select([self._ours], [], [], 1.0)[0]:
                piece = os.read(self._ours, 65536).decode("utf-8", "replace")
                printed = piece if without in printed else printed + piece

    def type(self, key: bytes) -> None:
        os.write(self._ours, key)

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def finish(self) -> int:
        with threading_reader(self._ours):
            status = self._process.wait(PATIENCE_S)
        os.close(self._ours)
        return status


@contextmanager
def threading_reader(fd: int) -> Iterator[None]:
    """Take what is still printed, so that nobody waits to write."""
    done = threading.Event()

    def run() -> None:
        while not done.is_set():
            try:
                if select.select([fd], [], [], 0.1)[0] and not os.read(fd, 65536):
                    return
            except OSError:
                return

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def check_the_pause(path: Path, status: int) -> None:
    """The session holds when it paused, and holds no reading of that time."""
    session = read_session(path)
    assert session.damage == ()
    states = [(d.t_ns, d.counters["state"]) for d in of(session, Diagnostics)]
    begin_ns = min(t_ns for t_ns, state in states if state == "paused")
    end_ns = min(t for t, state in states if state == "recording" and t > begin_ns)
    records = [r for r in session.records if not isinstance(r.message, Diagnostics)]
    assert not [r for r in records if begin_ns < r.log_ns < end_ns]
    assert [r for r in records if r.log_ns < begin_ns]
    assert [r for r in records if r.log_ns > end_ns]
    last = of(session, Diagnostics)[-1].counters
    assert int(last["pauses"]) == 1
    assert int(last["paused_messages"]) > 0
    lost = int(last["gaps"])  # none, unless this machine stood still for two seconds
    assert status == (1 if lost else 0)


def test_keys_on_a_terminal_pause_and_end(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    program = Program(path, terminal=True)
    program.wait_for("recording", "run.mcap", "ping", "dirrs", "space: pause")
    program.type(b" ")
    program.wait_for("PAUSED")
    time.sleep(0.3)  # the robot goes on sending
    program.type(b"p")
    program.wait_for("recording", "ping", without="PAUSED")
    time.sleep(0.3)
    program.type(b"q")
    check_the_pause(path, program.finish())


def test_signals_pause_and_end(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    program = Program(path, terminal=False)
    program.wait_for("ping")
    program.signal(signal.SIGUSR1)
    program.wait_for("PAUSED")
    program.signal(signal.SIGUSR1)
    program.wait_for("ping", without="PAUSED")
    program.signal(signal.SIGTERM)
    check_the_pause(path, program.finish())
