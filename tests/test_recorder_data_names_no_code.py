"""Nothing that stands in a file of data says what is run, or ends in a traceback."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from recorder.errors import BadInput
from recorder.messages import Range, RawLine
from recorder.playback import wheels_of
from recorder.recording.options import RecordingOptions
from recorder.recording.run import opened_source, record_line
from recorder.sensors import CATALOGUE
from recorder.session import Limits, SessionWriter, read_session

CODE = """
from pathlib import Path
from recorder.protocols import LineProtocol

Path(__file__).with_name("ran").write_text("ran")

class Mine(LineProtocol):
    name = "mine"

    def read(self, line):
        return None
"""
NAMES: tuple[object, ...] = (
    "{folder}/evil.py", "evil.py", "../evil.py", "{folder}/evil.py#csv", "mine", "", "CSV", "csv ",
    "ec\nho", "\x1b]0;x\x07", "x" * 100_000, None, 5, 1e308, True, ["csv"], {"csv": 1},
)  # fmt: skip


def session(tmp_path: Path, metadata: dict[str, object]) -> Path:
    (tmp_path / "evil.py").write_text(CODE)
    path = tmp_path / "run.mcap"
    with SessionWriter(path, metadata=metadata, force=True) as writer:
        writer.write(RawLine(1_000, "1,2\r\n"), log_ns=1_000)
        reading: Range = CATALOGUE["ping"].parameters.reading(2_000, "ping", 1.0)
        writer.write(reading, log_ns=2_000)
    return path


def record_again(path: Path, protocol: str = "echogrid") -> None:
    given = RecordingOptions(protocol=protocol, limits=Limits(min_free_mb=0.0))
    with opened_source(f"replay:{path}", given) as (source, options):
        record_line(source, path.with_name("again.mcap"), options, stop=threading.Event())


@pytest.mark.parametrize("name", NAMES, ids=range(len(NAMES)))
def test_a_sessions_metadata_name_built_in_protocols_only(
    tmp_path: Path, name: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if isinstance(name, str):
        name = name.replace("{folder}", str(tmp_path))
    path = session(tmp_path, {"protocol": name})
    with pytest.raises(BadInput, match="not built in: give its file with --protocol") as error:
        record_again(path)
    assert str(error.value).isprintable()
    assert len(str(error.value)) < 1000
    assert not (tmp_path / "ran").exists()


def test_a_python_file_from_the_command_line_is_run(tmp_path: Path) -> None:
    path = session(tmp_path, {"protocol": "mine"})
    record_again(path, str(tmp_path / "evil.py"))
    assert (tmp_path / "ran").exists()
    assert read_session(tmp_path / "again.mcap").metadata["protocol"] == "mine"


@pytest.mark.parametrize("columns", ["evil.py", "", "x" * 5000, 5, ["t_ms"], "ping:cm,ping:cm"])
def test_columns_that_cannot_be_are_refused_in_one_line(tmp_path: Path, columns: object) -> None:
    path = session(tmp_path, {"protocol": "csv", "columns": columns})
    with pytest.raises(BadInput) as error:
        record_again(path)
    assert str(error.value).isprintable()


@pytest.mark.parametrize(
    "wheels",
    [
        {}, {"ticks_per_m": "5", "track_m": 1.0}, {"ticks_per_m": 5.0}, {"track_m": 1.0},
        {"ticks_per_m": -5.0, "track_m": 1.0}, {"ticks_per_m": 1e999, "track_m": 1.0},
        {"ticks_per_m": 5.0, "track_m": 1.0, "counter_range": -3},
        {"ticks_per_m": True, "track_m": [1.0]}, {"__class__": 1, "x": 2},
    ],
)  # fmt: skip
def test_wheels_that_cannot_be_are_refused_in_one_line(wheels: object) -> None:
    with pytest.raises(BadInput, match="wheels that cannot be"):
        wheels_of({"wheels": wheels})
