"""A live run with real parts: pseudo-terminal, tracker, follower's process, viewer."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rerun.experimental import ViewerClient

from echogrid import main
from mapping.config import load_config
from recorder.errors import BadInput
from recorder.messages import Range
from recorder.recording import RecordingStatus
from recorder.recording.options import RecordingOptions
from recorder.recording.run import opened_source
from recorder.session import read_session
from replay.live.run import LiveResult, record_and_show
from replay.rrd.program import LOCAL, free_ports
from replay.rrd.viewer_process import ViewerProcess
from tests.viewer_support import not_here

CONFIG = load_config((), ["grid.resolution_m=0.05"], None)
MOST_S = 120.0


@pytest.fixture
def viewer() -> Iterator[ViewerProcess]:
    try:
        process = ViewerProcess(lambda ports: ["--headless", "--port", str(ports[0])], 1)
    except BadInput as error:
        not_here(str(error))
        raise
    yield process
    process.stop()


def url_of(viewer: ViewerProcess) -> str:
    return f"rerun+http://{LOCAL}:{viewer.ports[0]}/proxy"


class Run:
    """A live run of the simulated robot in a thread, looked at from outside."""

    def __init__(self, output: Path, url: str) -> None:
        self.output, self.url = output, url
        self.stop = threading.Event()
        self.status: RecordingStatus | None = None
        self.follower: int | None = None
        self.result: LiveResult | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        with opened_source("sim:room", RecordingOptions(), seed=1, speed=4.0) as (source, options):
            self.result = record_and_show(
                source, self.output, options, CONFIG, viewer_url=self.url, stop=self.stop,
                on_status=self._take, status_period_s=0.1, on_follower=self._meet, patience_s=60.0,
            )  # fmt: skip

    def _take(self, status: RecordingStatus) -> None:
        self.status = status

    def _meet(self, process_id: int | None) -> None:
        self.follower = process_id

    def received(self) -> int:
        return 0 if self.status is None else self.status.counters.received

    def until(self, condition: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + MOST_S
        while not condition():
            assert self._thread.is_alive(), "the run ended by itself"
            assert time.monotonic() < deadline_s, "it took too long"
            time.sleep(0.05)

    def until_received(self, more: int) -> None:
        wanted = self.received() + more
        self.until(lambda: self.received() >= wanted)

    def end(self) -> LiveResult:
        self.stop.set()
        self._thread.join(MOST_S)
        assert self.result is not None
        return self.result


def readings_written(output: Path) -> int:
    session = read_session(output)
    assert session.damage == ()
    return sum(isinstance(message, Range) for message in session.messages())


@pytest.mark.viewer
def test_the_map_is_in_the_viewer_while_the_robot_drives(
    tmp_path: Path, viewer: ViewerProcess
) -> None:
    run = Run(tmp_path / "live.mcap", url_of(viewer))
    client = ViewerClient.connect(url_of(viewer))

    def last_reading() -> float:
        timelines = [
            timeline for each in client.get_state().recordings for timeline in each.timelines
        ]
        return max((float(t.end) for t in timelines if t.name == "reading"), default=0.0)

    run.until(lambda: last_reading() > 50)
    assert run.result is None, "it was to be seen before the end"
    result = run.end()
    assert result.end.failure == ""
    assert result.end.not_followed == 0
    assert "readings, used:" in result.end.report
    assert "█" in result.end.report
    assert result.counters.gaps == result.counters.bad_checksum == 0
    assert readings_written(run.output) > 50


@pytest.mark.viewer
def test_a_viewer_that_is_closed_stops_neither_map_nor_recording(
    tmp_path: Path, viewer: ViewerProcess
) -> None:
    run = Run(tmp_path / "live.mcap", url_of(viewer))
    run.until_received(200)
    os.kill(viewer.process_id, signal.SIGKILL)
    run.until_received(200)
    result = run.end()
    assert result.counters.failure == ""
    assert result.counters.gaps == 0
    assert "readings, used:" in result.end.report
    assert readings_written(run.output) > 100


def test_a_map_that_dies_leaves_the_recording_whole(tmp_path: Path) -> None:
    nobody = f"rerun+http://{LOCAL}:{free_ports(1)[0]}/proxy"
    run = Run(tmp_path / "live.mcap", nobody)
    run.until_received(100)
    assert run.follower is not None
    os.kill(run.follower, signal.SIGKILL)
    run.until_received(300)
    result = run.end()
    assert result.end.failure == "its process ended (exit code -9)"
    assert result.counters.failure == ""
    assert result.counters.gaps == 0
    assert result.counters.written == len(list(read_session(run.output).messages()))


def test_a_map_that_hangs_is_left_behind(tmp_path: Path) -> None:
    nobody = f"rerun+http://{LOCAL}:{free_ports(1)[0]}/proxy"
    run = Run(tmp_path / "live.mcap", nobody)
    run.until_received(50)
    assert run.follower is not None
    os.kill(run.follower, signal.SIGSTOP)
    run.until_received(300)
    os.kill(run.follower, signal.SIGCONT)  # it may catch up: nothing was lost in the queue
    result = run.end()
    assert result.end.failure == ""
    assert result.counters.gaps == 0
    assert readings_written(run.output) > 100


def test_the_command_records_and_maps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    nobody = f"rerun+http://{LOCAL}:{free_ports(1)[0]}/proxy"
    arguments = ["live", "sim:room", "--viewer", nobody, "-o", str(folder), "--duration", "4"]
    assert main([*arguments, "--set", "grid.resolution_m=0.05"]) == 0
    output = capsys.readouterr().out
    assert "readings, used:" in output
    assert f"wrote {folder / 'live.rrd'}" in output
    assert readings_written(folder / "live.mcap") > 50
    assert main(arguments) == 2
    assert "exists" in capsys.readouterr().err


def test_without_a_recording_the_live_map_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    nobody = f"rerun+http://{LOCAL}:{free_ports(1)[0]}/proxy"
    arguments = ["live", "sim:room", "--viewer", nobody, "-o", str(folder), "--duration", "4"]
    assert main([*arguments, "--no-map", "--set", "grid.resolution_m=0.05"]) == 0
    output = capsys.readouterr().out
    assert "readings, used:" in output
    assert "█" in output
    assert not (folder / "live.rrd").exists()


def test_without_a_display_nothing_is_begun(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("replay.viewer.has_display", lambda: False)
    monkeypatch.chdir(tmp_path)
    assert main(["live", "sim:room"]) == 2
    assert "use --web" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
