"""``info`` and ``recover``: what is in a session, what is odd about it, and what can be saved."""

from __future__ import annotations

import itertools
import math
import random
import re
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from echogrid import main
from recorder.geometry import SE2
from recorder.messages import (
    Diagnostics,
    Message,
    Pose,
    Radiation,
    Range,
    Scan,
    Transform,
)
from recorder.ros_definitions import DEFINITIONS
from recorder.ros_types import encode
from recorder.session import SessionReader, SessionWriter, read_session
from recorder.session.recover import recover
from recorder.session.stats import Readings, Times
from recorder.summary import summary_lines

T_NS = 1_700_000_000_000_000_000
STEP_NS = 50_000_000
Log = tuple[int, Message]


def ping(i: int, range_m: float) -> Range:
    return Range(T_NS + i * STEP_NS, "ping", range_m, 0.663, 0.02, 4.0, Radiation.ULTRASOUND)


def dirrs(i: int, range_m: float) -> Range:
    return Range(T_NS + i * STEP_NS, "dirrs", range_m, 0.105, 0.1, 0.8, Radiation.INFRARED)


def pose(i: int, x_m: float, heading_rad: float = 0.0) -> Pose:
    return Pose(T_NS + i * STEP_NS, SE2(x_m, 1.0, heading_rad))


MOUNTS = [Transform(T_NS, "base_link", name, SE2(0.0, 0.0, 0.0)) for name in ("ping", "dirrs")]


def good_run(count: int = 200) -> list[Message]:
    messages: list[Message] = [*MOUNTS]
    for i in range(count):
        messages += [
            pose(i, 0.01 * i), ping(i, 1.0 + 0.5 * math.sin(i)), dirrs(i, 0.5 + 0.2 * math.sin(i))
        ]  # fmt: skip
    return messages


def session(path: Path, messages: Iterable[Message], **metadata: object) -> Path:
    with SessionWriter(path, metadata=metadata, force=True) as writer:
        for message in messages:
            writer.write(message, log_ns=message.t_ns + 1_000_000)
    return path


def lines_of(path: Path) -> list[str]:
    return list(summary_lines(SessionReader(path)))


def odd(path: Path) -> list[str]:
    return [line.removeprefix("  odd: ") for line in lines_of(path) if line.startswith("  odd: ")]


def test_a_good_run_has_nothing_odd(tmp_path: Path) -> None:
    lines = lines_of(session(tmp_path / "s.mcap", good_run(), protocol="echogrid"))
    assert lines == [
        "s.mcap: 602 messages, 9.9 s, from 2023-11-14 22:13:20 UTC",
        "  /pose                    200     20.0/s  no gaps  x 0.00 to 1.99 m, y 1.00 to 1.00 m",
        "  /range/dirrs             200     20.0/s  no gaps  infrared 0.30 to 0.70 m, 0 saw none",
        "  /range/ping              200     20.0/s  no gaps  ultrasound 0.50 to 1.50 m, 0 saw none",
        "  /tf_static                 2",
        "  mapped from poses: /pose (taken where there is one)",
        "  mapped from readings: /range/ping as sensors.ping (frame ping < base_link)",
        "  mapped from readings: /range/dirrs as sensors.dirrs (frame dirrs < base_link)",
        "  protocol = echogrid",
    ]


def test_the_page_on_sessions_shows_what_info_prints() -> None:
    page = (ROOT / "docs" / "sessions.md").read_text("utf-8")
    shown = page.split("$ echogrid info logs/room.mcap\n")[1].split("```")[0]
    assert shown.splitlines() == lines_of(ROOT / "logs" / "room.mcap")


def test_the_page_on_sessions_cuts_where_something_is_left(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "sessions.md").read_text("utf-8")
    [size] = re.findall(r"`head -c (\d+) logs/room.mcap > cut.mcap; echogrid info cut.mcap`", page)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((ROOT / "logs" / "room.mcap").read_bytes()[: int(size)])
    lines = lines_of(cut)
    assert int(lines[0].split()[1]) > 500
    assert any(line.startswith("  lost: ") for line in lines)


def test_metadata_is_readable(tmp_path: Path) -> None:
    facts = {
        "dropped": {"pose without readings": 1}, "nothing": {}, "tracker": "", "on": True,
        "sensors": {"ping": {"beam_width_deg": 38.0, "kind": "x"}, "left": {"kind": "y"}},
        "versions": {"echogrid": "0.1.0", "python": "3.11"}, "list": [1, "b"],
    }  # fmt: skip
    lines = lines_of(session(tmp_path / "s.mcap", [ping(0, 1.0)], **facts))
    assert lines[0].startswith("s.mcap: 1 message, ")
    assert [line.strip() for line in lines if " = " in line] == [
        "dropped = pose without readings 1", "list = 1, b", "nothing = none", "on = yes",
        "sensors.left = kind y", "sensors.ping = beam_width_deg 38.0, kind x", "tracker = none",
        "versions = echogrid 0.1.0, python 3.11",
    ]  # fmt: skip


def swapped(messages: list[Message]) -> list[Message]:
    """The sonar's ranges on the infrared channel, and the other way round."""
    found: list[Message] = []
    for i, message in enumerate(messages, start=-len(MOUNTS)):
        match message:
            case Range(sensor="ping"):
                found.append(ping(i // 3, 0.4))
            case Range(sensor="dirrs"):
                found.append(dirrs(i // 3, 1.4 + 0.1 * math.sin(i)))
            case _:
                found.append(message)
    return found


def changed(change: Callable[[int, Message], Message]) -> list[Message]:
    return [*MOUNTS, *(change(i // 3, message) for i, message in enumerate(good_run()[2:]))]


def of(sensor: str, reading: Callable[[int], Range]) -> list[Message]:
    """A good run in which one sensor sends something else."""
    return changed(
        lambda i, m: reading(i) if isinstance(m, Range) and m.sensor == sensor else m
    )  # fmt: skip


def poses(other: Callable[[int], Pose]) -> list[Message]:
    return changed(lambda i, m: other(i) if isinstance(m, Pose) else m)


CASES: dict[str, tuple[list[Message], str]] = {
    "swapped": (
        swapped(good_run()),
        "/range/dirrs: 100% of its ranges lie beyond 0.8 m, which it does not reach, "
        "and /range/ping never gets there: are the channels swapped?",
    ),
    "a glitch": (
        of("dirrs", lambda i: dirrs(i, 2.55 if i == 9 else 0.4 + i / 1000)),
        "/range/dirrs: infrared beyond 0.8 m (2.55 m)",
    ),
    "stuck": (of("ping", lambda i: ping(i, 1.234)), "/range/ping: says 1.234 m all the time"),
    "all max": (of("ping", lambda i: ping(i, 4.0)), "/range/ping: saw nothing all the time"),
    "all inf": (of("dirrs", lambda i: dirrs(i, math.inf)), "/range/dirrs: saw nothing all"),
    "too close": (
        of("ping", lambda i: ping(i, -math.inf)), "/range/ping: everything is too close"
    ),
    "nonsense": (
        of("ping", lambda i: ping(i, (math.nan, 0.0, -1.0, 1.0, 1.5)[i % 5])),
        "/range/ping: 120 readings are zero, negative or not a number",
    ),
    "jump": (
        poses(lambda i: pose(i, 0.01 * i + (1.5 if i >= 100 else 0.0))),
        "/pose: jumps once, at most 1.51 m, at 5.0 s",
    ),
    "flip": (
        poses(lambda i: pose(i, 0.01 * i, math.pi if i == 50 else 0.0)),
        "/pose: the heading turns by over 90 degrees at a stroke, 2 times",
    ),
    "still": (poses(lambda i: pose(i, 0.0)), "/pose: never changes"),
    "no finite pose": (poses(lambda i: pose(i, math.nan)), "/pose: 200 poses are not finite"),
    "no mounts": (good_run()[2:], "no transform mounts dirrs, ping on the robot"),
    "no poses": ([m for m in good_run() if not isinstance(m, Pose)], "no poses: nothing can be"),
    "no ranges": ([m for m in good_run() if not isinstance(m, Range)], "no ranges: there is"),
    "other times": (
        poses(lambda i: pose(i + 10_000, 0.01 * i)),
        "the poses and the ranges are of different times",
    ),
    "counters": (
        [*good_run(), Diagnostics(T_NS, "recorder", {"gaps": 3, "reconnects": "1", "cut": 0})],
        "the recorder counted: gaps 3, reconnects 1",
    ),
    "no width": (
        of("ping", lambda i: Range(T_NS + i, "ping", 1.0 + i, 0.0, 0.0, 0.0, Radiation.ULTRASOUND)),
        "/range/ping: its messages name no width of the beam",
    ),
    "blind lidar": (
        [*good_run(), *(Scan(T_NS + i, "l", np.full(9, np.inf), -1, 0.1, 0, 9) for i in range(20))],
        "/scan/l: not one beam saw anything",
    ),
    "clock back": (
        of("ping", lambda i: ping(i - (40 if i >= 100 else 0), 1.0 + i / 500)),
        "/range/ping: its clock steps back once",
    ),
    "clock stands": (
        of("ping", lambda i: ping(0, 1.0 + i / 500)), "/range/ping: its clock stands still"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_what_is_odd_is_named(tmp_path: Path, name: str) -> None:
    messages, expected = CASES[name]
    path = session(tmp_path / "s.mcap", messages)
    assert any(line.startswith(expected) for line in odd(path)), odd(path)
    assert main(["info", str(path), "--quiet"]) == 0  # odd, but nothing is lost


def test_a_clock_that_steps_against_the_arrivals_is_named(tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    with SessionWriter(path) as writer:
        for i in range(100):
            late_ns = 5_000_000_000 if i >= 60 else 0
            writer.write(ping(i, 1.0 + i / 100), log_ns=T_NS + i * STEP_NS + late_ns)
    assert "/range/ping: its clock steps against that of the arrivals once" in odd(path)


def test_an_arrival_clock_that_steps_back_is_named(tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    with SessionWriter(path) as writer:
        for i in range(100):
            back_ns = 9_000_000_000 if i >= 60 else i % 2 * 70_000_000  # overtaking is no step
            writer.write(ping(i, 1.0 + i / 100), log_ns=T_NS + i * STEP_NS - back_ns)
    assert "the clock of the arrivals steps back once" in odd(path)


def test_columns_that_an_import_was_given_wrongly(tmp_path: Path) -> None:
    messages = of("ping", lambda i: ping(i, 0.4 + i / 1000))
    facts = {"dropped": {"infrared above 80 cm": 90}, "columns": "ping,dirrs"}
    found = odd(session(tmp_path / "s.mcap", messages, **facts))
    assert found == [
        "31% of the infrared readings were dropped at the import, for they lay above 80 cm, and "
        "/range/ping never gets there: are the columns swapped?"
    ]


def test_swapped_columns_of_a_real_trace_are_seen(shared_data: Path, tmp_path: Path) -> None:
    trace, path = shared_data / "comp4807" / "trace21.trc", tmp_path / "s.mcap"
    arguments = ["import", str(trace), "-o", str(path), "--quiet", "--force"]
    assert main(arguments) == 0
    assert not any("swapped" in line for line in odd(path))
    assert main([*arguments, "--columns", "ping,dirrs"]) == 0
    assert sum("swapped" in line for line in odd(path)) == 1


@settings(deadline=None, max_examples=60)
@given(
    steps=st.lists(st.integers(-(10**9), 10**12), min_size=1, max_size=60),
    period=st.integers(10**5, 10**10),
)
def test_times_count_what_a_list_would(steps: list[int], period: int) -> None:
    times, now = Times(), T_NS
    stamps = [now]
    for step in steps:
        now += step if step % 3 else period
        stamps.append(now)
    for stamp in stamps:
        times.take(stamp, stamp)
    taken = [b - a for a, b in itertools.pairwise(stamps)]
    assert times.back == sum(step < 0 for step in taken)
    assert times.longest_ns == max(0, *taken)
    assert times.span_s == pytest.approx((max(stamps) - min(stamps)) / 1e9)
    forward = sorted(step for step in taken if step > 0)
    if forward:
        median = forward[(len(forward) - 1) // 2]
        assert times.usual_ns == pytest.approx(median, rel=0.05)
        surely = sum(step > 5 * median * 1.1 for step in forward)
        perhaps = sum(step > 5 * median / 1.1 for step in forward)
        assert surely <= times.gaps <= perhaps


@settings(deadline=None, max_examples=60)
@given(values=st.lists(st.floats(allow_nan=True, width=32), max_size=40))
def test_readings_count_every_value_once(values: list[float]) -> None:
    readings = Readings("ping", Radiation.ULTRASOUND, 4.0, 0.6)
    for value in values:
        readings.take(value)
    good = [v for v in values if v > 0 and math.isfinite(v)]
    assert readings.count == len(values)
    assert readings.finite == len(good)
    assert readings.too_close == sum(v == -math.inf for v in values)
    infinite = sum(v == math.inf for v in values)
    assert readings.finite + infinite + readings.too_close + readings.unusable == len(values)
    assert readings.least_m == min(good, default=math.inf)
    assert 0.0 <= readings.share_beyond(0.8) <= 1.0


GAPS = [ping(i + (60 if i >= 100 else 0), 1.0 + i / 500) for i in range(200)]


def test_gaps_are_counted_and_the_longest_is_dated(tmp_path: Path) -> None:
    [line] = [one for one in lines_of(session(tmp_path / "s.mcap", GAPS)) if "/range/ping" in one][
        :1
    ]
    assert "gaps 1 (longest 3.05 s, at 5.0 s)" in line


def foreign(path: Path, *, chunked: bool = True, crcs: bool = True, library: str = "other") -> Path:
    """Another program's file: odd topics, an unknown type, a broken one, raw metadata, a file."""
    with path.open("wb") as file:
        writer = Writer(
            file, use_chunking=chunked, enable_crcs=crcs, compression=CompressionType.LZ4
        )
        writer.start(profile="ros2", library=library)
        channels = {
            "/sonar": ("sensor_msgs/msg/Range", DEFINITIONS["sensor_msgs/msg/Range"]),
            "/unknown": ("our_msgs/msg/Odd", "float64 value"),
            "/broken": ("sensor_msgs/msg/Range", "this is ! no definition\n= ="),
        }
        ids = {}
        for topic, (name, text) in channels.items():
            schema_id = writer.register_schema(name, "ros2msg", text.encode())
            ids[topic] = writer.register_channel(topic, "cdr", schema_id)
        writer.add_metadata("theirs", {"key": "value"})
        writer.add_attachment(3, 4, "photo.png", "image/png", b"not a photo")
        for i in range(10):
            for topic, channel_id in ids.items():
                data = encode(ping(i, 1.0)) if topic == "/sonar" else b"\0\1\0\0" + bytes(8)
                writer.add_message(channel_id, T_NS + i, data, T_NS + i, sequence=40 + i)
        writer.finish()
    return path


def test_a_foreign_file_is_read_as_far_as_it_is_understood(tmp_path: Path) -> None:
    path = foreign(tmp_path / "bag.mcap")
    lines = lines_of(path)
    assert "  /unknown                  10  not understood (our_msgs/msg/Odd)" in lines
    assert any(line.startswith("  lost: /broken: sensor_msgs/msg/Range: the") for line in lines)
    found = read_session(path)
    assert [r.topic for r in found.records] == ["/sonar"] * 10
    assert found.attachments == {"photo.png": b"not a photo"}


@pytest.mark.parametrize(("chunked", "crcs"), [(False, True), (True, False)])
def test_what_no_checksum_covers_is_reported(tmp_path: Path, chunked: bool, crcs: bool) -> None:
    path = foreign(tmp_path / "bag.mcap", chunked=chunked, crcs=crcs)
    reader = SessionReader(path)
    assert len(list(reader.records())) == 10
    if not chunked:
        assert reader.unverified == 30
        assert "no checksum covers 30 messages (another program's file)" in odd(path)


def test_a_foreign_file_is_recovered_with_all_that_it_holds(tmp_path: Path) -> None:
    path, good = foreign(tmp_path / "bag.mcap"), tmp_path / "good.mcap"
    whole = recover(path, good)
    assert (whole.messages, whole.attachments, whole.lost) == (30, 1, ())
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: path.read_bytes().rindex(b"photo.png") - 60])
    assert main(["recover", str(cut), "-o", str(good), "--force"]) == 1
    assert SessionReader(good).path.read_bytes().count(b"theirs") == 2  # the record and its index
    channels = {c.topic: c.messages for c in _walked(good).channels.values()}
    assert channels == {"/sonar": 10, "/unknown": 10, "/broken": 10}


def _walked(path: Path) -> SessionReader:
    reader = SessionReader(path)
    for _ in reader.records():
        pass
    return reader


def test_the_commands_and_their_exit_codes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = session(tmp_path / "s.mcap", good_run(), protocol="echogrid")
    bad, good = tmp_path / "bad.mcap", tmp_path / "good.mcap"
    assert main(["recover", str(path), "-o", str(good)]) == 0
    assert capsys.readouterr().out == f"{good}: 602 messages; nothing was lost\n"
    assert read_session(good).records == read_session(path).records

    bad.write_bytes(path.read_bytes()[:-2000])
    assert main(["info", str(bad)]) == 1
    assert "  lost: " in capsys.readouterr().out
    assert main(["recover", str(bad), "-o", str(good)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["recover", str(bad), "-o", str(bad), "--force"]) == 2
    assert "never mended in place" in capsys.readouterr().err
    assert main(["recover", str(bad), "-o", str(good), "--force"]) == 1
    captured = capsys.readouterr()
    assert captured.err.startswith("echogrid: lost: ")
    assert captured.out.endswith("some was lost\n")
    assert main(["info", str(good)]) == 0
    assert "recovered from bad.mcap, where was lost:" in capsys.readouterr().out

    for content in (b"", b"nothing of the kind" * 9, path.read_bytes()[:30]):
        bad.write_bytes(content)
        reason = "an empty file" if not content else ""
        for command in (["info", str(bad)], ["recover", str(bad), "-o", str(good), "--force"]):
            assert main(command) == 2
            captured = capsys.readouterr()
            assert captured.out == ""
            assert captured.err.count("\n") == 1
            assert f"bad.mcap: {reason}" in captured.err
    assert main(["recover", str(tmp_path / "none.mcap"), "-o", str(good), "--force"]) == 2
    assert "none.mcap" in capsys.readouterr().err
    assert main(["recover", str(path), "-o", str(tmp_path / "no" / "folder.mcap")]) == 2
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.mcap", "good.mcap", "s.mcap"]


def test_a_disk_with_too_little_room_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["record", "sim:room", "-o", str(tmp_path / "s.mcap"), "--min-free-mb", "1e12"]
    assert main(arguments) == 2
    assert "of the disk are free" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


MEMORY = textwrap.dedent("""
    import resource, sys
    from pathlib import Path
    from recorder.session import SessionReader
    from recorder.session.recover import recover
    from recorder.summary import summary_lines
    lines = list(summary_lines(SessionReader(Path(sys.argv[1]))))
    recover(Path(sys.argv[1]), Path(sys.argv[2]))
    print(lines[0].split()[1], resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
""")


def test_info_and_recover_do_not_take_memory_with_the_length(tmp_path: Path) -> None:
    """Twenty times the session, and no more memory than some buffers."""
    rng, used_kib = random.Random(3), {}
    for count in (2_000, 40_000):
        path = tmp_path / f"{count}.mcap"
        with SessionWriter(path) as writer:
            for i in range(count):
                writer.write(pose(i, rng.random(), rng.random()), log_ns=T_NS + i)
        run = subprocess.run(
            [sys.executable, "-c", MEMORY, str(path), str(tmp_path / f"good-{count}.mcap")],
            cwd=ROOT, capture_output=True, text=True, check=True, timeout=300,
        )  # fmt: skip
        messages, used_kib[count] = map(int, run.stdout.split())
        assert messages == count
    # 40 000 records and their poses, kept as objects, would be over 20 MB
    assert used_kib[40_000] - used_kib[2_000] < 8_000, used_kib
