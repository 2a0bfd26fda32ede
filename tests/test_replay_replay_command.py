"""``replay`` and ``record replay:S.mcap``: recorded hardware stands in for hardware."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

import pytest
from fake_links import Collector
from playback_sessions import session_file

from echogrid import main
from recorder.clock import HostClock
from recorder.errors import BadInput
from recorder.link import Link
from recorder.messages import Pose, Range, Transform
from recorder.playback import mounts_of, playback_of
from recorder.recording.options import RecordingOptions
from recorder.recording.run import opened_source
from recorder.session import read_session
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
