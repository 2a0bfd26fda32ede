"""``replay`` and ``record replay:S.mcap``: recorded hardware stands in for hardware."""

from __future__ import annotations

import os
import shlex
import signal
import socket
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

import pytest
from fake_links import Collector
from playback_sessions import session_file

from echogrid import main
from recorder.clock import HostClock
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.link import Link
from recorder.messages import Pose, Range, RawLine, Record, Transform
from recorder.playback import mounts_of, playback_of
from recorder.playback.command import record_command
from recorder.recording.options import RecordingOptions, parse_mount, parse_wheels
from recorder.recording.run import opened_source
from recorder.session import Session, read_session
from recorder.truth import WALLS


def test_record_takes_a_session_for_a_device(tmp_path: Path) -> None:
    file, again = tmp_path / "s.mcap", tmp_path / "again.mcap"
    records = session_file(file, 1.5)
    assert main(["record", f"replay:{file}", "-o", str(again), "--quiet"]) == 0
    again_run = read_session(again)
    assert again_run.damage == ()
    for kind in (Range, Pose):
        was = [r.message for r in records if isinstance(r.message, kind)]
        now = [m for m in again_run.messages() if isinstance(m, kind)]
        assert len(now) == len(was) > 10
    assert WALLS in again_run.attachments
    transforms = [m for m in again_run.messages() if isinstance(m, Transform)]
    mounts = [(m.child, m.parent_from_child) for m in transforms]
    assert mounts == [(m.child, m.parent_from_child) for m in mounts_of(records)]
    assert again_run.metadata["source"] == f"replay:{file}"
    assert again_run.metadata["wheels"] == {"ticks_per_m": 2.0, "track_m": 0.1}
    opening = opened_source(f"replay:{file}", RecordingOptions(tracker="tcp://127.0.0.1:1"))
    with pytest.raises(BadInput, match="its own tracker"):
        opening.__enter__()


def test_the_command_plays_to_a_socket(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], free_port: int
) -> None:
    file = tmp_path / "s.mcap"
    records = session_file(file, 1.0)
    codes: list[int] = []
    to = f"socket://127.0.0.1:{free_port}"
    player = threading.Thread(
        target=lambda: codes.append(main(["replay", str(file), "--to", to, "--fast"])), daemon=True
    )
    collector = Collector(Link(to, clock=HostClock(), wait=True))
    player.start()
    player.join(60)
    playback = playback_of(records)
    lines = [s.payload for s in playback.transmissions if isinstance(s.payload, bytes)]
    collector.wait_for_data(lines[-1])
    collector.finish()
    assert codes == [0]
    assert collector.data == b"".join(lines)
    output = capfd.readouterr()
    assert output.out.splitlines()[0] == to
    assert f"sent {len(lines)} lines, {len(collector.data)} bytes, 0 poses" in output.out
    assert "of /odom" in output.err


@pytest.fixture
def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def test_the_command_refuses_what_makes_no_sense(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.mcap"
    session_file(file, 0.2)
    assert main(["replay", str(file), "--to", "none"]) == 2
    assert "--tracker-port" in capfd.readouterr().err
    assert main(["replay", str(file), "--speed", "-2"]) == 2
    assert "speed" in capfd.readouterr().err
    assert main(["replay", str(tmp_path / "missing.mcap")]) == 2
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert main(["replay", str(file), "--to", "none", "--tracker-port", port]) == 2
    assert "cannot listen" in capfd.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_prints_the_line_to_record_it_with_and_a_signal_stops_it(
    tmp_path: Path, number: signal.Signals
) -> None:
    file, again = tmp_path / "s.mcap", tmp_path / "again.mcap"
    session_file(file, 20.0)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    command = [sys.executable, "-m", "echogrid", "replay", str(file), "--tracker-port", "0"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as playing:
        assert playing.stdout is not None
        assert playing.stderr is not None
        port, tracker, line = (playing.stdout.readline().strip() for _ in range(3))
        words = shlex.split(line.removeprefix("record it with:"))
        assert words[:7] == ["echogrid", "record", port, "-o", "again.mcap", "--tracker", tracker]
        words[4:5] = [str(again), "--duration", "1", "--quiet"]
        assert main(words[1:]) == 0
        playing.send_signal(number)
        assert playing.wait(30) == 130
        assert "stopped" in playing.stderr.read()
    kinds = Counter(type(message) for message in read_session(again).messages())
    assert min(kinds[Range], kinds[Pose], kinds[Transform]) > 0


def test_the_line_holds_what_the_session_was_recorded_with() -> None:
    text = "t_ms,left,right,ping:cm"
    metadata = {
        "protocol": "csv", "columns": text,
        "wheels": {"ticks_per_m": 100.0, "track_m": 0.4, "counter_range": 9000},
    }  # fmt: skip
    raw, mount = RawLine(1, "x"), Transform(1, "head", "ping", SE2(0.1, -0.2, 0.5))
    records = tuple(Record("/x", 1, message) for message in (raw, mount))
    session = Session(Path("s.mcap"), records, metadata=metadata, attachments={}, damage=())
    words = shlex.split(record_command(session, "/dev/pts/3", None))
    wheels = parse_wheels(words[words.index("--wheels") + 1])
    assert (wheels.track_m, wheels.counter_range) == (0.4, 9000)
    assert wheels.ticks_per_m == pytest.approx(100.0)
    assert words[words.index("--columns") + 1] == text
    assert parse_mount(words[words.index("--mount") + 1]).parent == "head"
