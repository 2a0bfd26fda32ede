"""Traces of the comp4807 tracker program, made by hand and real."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.importers import IMPORTERS, Imported, guess_format, import_comp4807
from recorder.messages import Pose, Radiation, Range, Transform

HEADER = "x,y,angle,Dirrs+|0|-3|0|0.05|3,Sonar|0|4|0|0.10|19"


def trace(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "made.trc"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("latin-1"))
    return path


def ranges(imported: Imported) -> list[tuple[int, str, float]]:
    messages = [message for _, message in imported.records]
    return [(m.t_ns // 10**6, m.sensor, m.range_m) for m in messages if isinstance(m, Range)]


def poses(imported: Imported) -> list[tuple[int, SE2]]:
    messages = [message for _, message in imported.records]
    return [(m.t_ns // 10**6, m.world_from_base) for m in messages if isinstance(m, Pose)]


def test_times_poses_and_metres(tmp_path: Path) -> None:
    text = f"{HEADER},10,20\r\n300,600,90,30,40,31,41\r\n-1,-1,-1,32,42\r\n330,600,270,33,0"
    found = import_comp4807(trace(tmp_path, text))
    assert ranges(found) == [
        (0, "dirrs", 0.10), (0, "ping", 0.20),
        (50, "dirrs", 0.30), (50, "ping", 0.40),
        (100, "dirrs", 0.31), (100, "ping", 0.41),
        (150, "dirrs", 0.32), (150, "ping", 0.42),
        (200, "dirrs", 0.33), (200, "ping", math.inf),
    ]  # fmt: skip
    assert [t_ms for t_ms, _ in poses(found)] == [50, 100, 200]
    first, last = poses(found)[0][1], poses(found)[-1][1]
    assert (first.x_m, first.y_m, first.heading_rad) == pytest.approx((1.0, 2.0, math.pi / 2))
    assert (last.x_m, last.heading_rad) == pytest.approx((1.1, -math.pi / 2))
    assert found.dropped == {}
    kinds = [type(message) for log_ns, message in found.records if log_ns == 50_000_000]
    assert kinds == [Pose, Range, Range]
    assert all(log_ns == message.t_ns for log_ns, message in found.records)


def test_mounts_beams_limits_and_metadata(tmp_path: Path) -> None:
    text = f"{HEADER},Side-Eye 2|90|1|-2|0.2|5\n0,0,0,30,40,50\n"
    found = import_comp4807(trace(tmp_path, text), rate_hz=10.0, start_s=7.0)
    mounts = {m.child: m.parent_from_child for _, m in found.records if isinstance(m, Transform)}
    assert mounts["ping"] == SE2(0.044, 0.0, 0.0)
    assert mounts["dirrs"] == SE2(-0.0312, 0.0, 0.0)
    assert mounts["side_eye_2"] == SE2(0.01, -0.02, math.radians(90.0))
    by_name = {m.sensor: m for _, m in found.records if isinstance(m, Range)}
    assert by_name["ping"].beam_width_rad == pytest.approx(math.radians(38.0))
    assert by_name["dirrs"].beam_width_rad == pytest.approx(math.radians(6.0))
    assert (by_name["ping"].min_range_m, by_name["ping"].max_range_m) == (0.02, 4.0)
    assert (by_name["dirrs"].min_range_m, by_name["dirrs"].max_range_m) == (0.1, 0.8)
    assert by_name["dirrs"].radiation is Radiation.INFRARED
    assert by_name["ping"].t_ns == 7 * 10**9
    assert found.metadata["format"] == "comp4807"
    assert found.metadata["rate_hz"] == "10.0"
    assert "assumption" in found.metadata["rate_note"]
    assert found.metadata["error_fraction.dirrs"] == "0.05"
    assert found.metadata["columns"] == "dirrs,ping,side_eye_2"


def test_a_mount_that_the_header_puts_elsewhere_is_believed(tmp_path: Path) -> None:
    found = import_comp4807(trace(tmp_path, "x,y,angle,Sonar|0|10|0|0.1|19\n0,0,0,40"))
    mounts = [m.parent_from_child for _, m in found.records if isinstance(m, Transform)]
    assert mounts == [SE2(0.1, 0.0, 0.0)]


def test_what_is_dropped_is_counted_and_keeps_its_time(tmp_path: Path) -> None:
    rows = ["0,0,0,111,111,81,81,80,-1,abc,20,nan,1e300,1_0", "5,5", "1e300,0,0,30,40", "2,2,2"]
    rows += ["nan,0,0,30,40", "a,0,0,30,40", "3,3,3,12,13,"]
    found = import_comp4807(trace(tmp_path, "\n".join([HEADER, *rows])))
    assert found.dropped == {
        "invalid 111": 2, "infrared above 80 cm": 1, "reading not a number": 1,
        "reading not finite": 1, "reading out of bounds": 1, "incomplete group": 1,
        "incomplete row": 1, "pose out of bounds": 1, "pose without readings": 1,
        "pose not finite": 1, "pose not a number": 1,
    }  # fmt: skip
    assert ranges(found)[:4] == [
        (50, "ping", 0.81), (100, "dirrs", 0.80), (100, "ping", math.inf), (150, "ping", 0.20),
    ]  # fmt: skip
    assert [t_ms for t_ms, _ in poses(found)] == [0, 50, 100, 150, 200, 400]


def test_columns_in_another_order(tmp_path: Path) -> None:
    path = trace(tmp_path, f"{HEADER}\n0,0,0,200,30")
    found = import_comp4807(path, columns=("Sonar", "dirrs"))
    assert ranges(found) == [(0, "ping", 2.0), (0, "dirrs", 0.3)]
    assert found.metadata["columns"] == "ping,dirrs"
    for wrong in [("ping",), ("ping", "ping"), ("ping", "lidar"), ()]:
        with pytest.raises(BadInput, match="must name each of dirrs,ping once"):
            import_comp4807(path, columns=wrong)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "not a comp4807 trace"),
        (bytes(range(256)) * 9, "not a comp4807 trace"),
        (b"1,2,3,4,5\n", "not a comp4807 trace"),
        (b"x,y,angle,Sonar|0|4\n0,0,0,4", "is not NAME"),
        (b"x,y,angle,Sonar|0|4|0|0.1|nan\n0,0,0,4", "is not NAME"),
        (b"x,y,angle,Sonar|0|4|0|0.1|0\n0,0,0,4", "half beam"),
        (b"x,y,angle,5,Sonar|0|4|0|0.1|19\n0,0,0,4", "names no sensor"),
        (HEADER.encode(), r"not one reading with a pose \(no reading at all\)"),
        (HEADER.encode() + b",10,20", "1 group of readings without one"),
        (HEADER.encode() + b",10,20\n3,4,5\n-1,-1,-1,7,8", "not one reading with a pose"),
    ],
)
def test_no_trace_is_one_line(tmp_path: Path, text: bytes, reason: str) -> None:
    path = trace(tmp_path, text)
    with pytest.raises(BadInput, match=reason) as caught:
        import_comp4807(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize(("rate_hz", "start_s"), [(0.0, 0.0), (math.nan, 0.0), (20.0, -1.0)])
def test_a_bad_clock(tmp_path: Path, rate_hz: float, start_s: float) -> None:
    with pytest.raises(BadInput, match=r"^(rate|start) .*must be"):
        import_comp4807(trace(tmp_path, f"{HEADER}\n0,0,0,30,40"), rate_hz=rate_hz, start_s=start_s)


def test_guessing_the_format(tmp_path: Path) -> None:
    assert IMPORTERS[guess_format(trace(tmp_path, HEADER))].read is import_comp4807
    with pytest.raises(BadInput, match="no format known"):
        guess_format(trace(tmp_path, b"\x00\xff"))
    with pytest.raises(BadInput, match="cannot be read"):
        guess_format(tmp_path / "absent")
    with pytest.raises(BadInput, match="cannot be read"):
        import_comp4807(tmp_path)


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "rows", "pairs"), [("trace21", 495, 8757), ("trace9", 371, 2606), ("trace18", 36, 820)]
)
def test_real_traces(shared_data: Path, name: str, rows: int, pairs: int) -> None:
    path = shared_data / "comp4807" / f"{name}.trc"
    found = import_comp4807(path)
    assert len(path.read_text().splitlines()) == rows + 1
    lost = sum(n for why, n in found.dropped.items() if not why.startswith("pose"))
    assert len(ranges(found)) + lost == 2 * pairs
    assert max(t_ms for t_ms, _, _ in ranges(found)) == 50 * (pairs - 1)


@pytest.mark.real_data
def test_real_readings_glued_to_the_header_have_no_pose(shared_data: Path) -> None:
    found = import_comp4807(shared_data / "comp4807" / "trace1.trc")
    assert poses(found)[0][0] == 50 * 596 // 2
    assert ranges(found)[0] == (0, "dirrs", 0.14)


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["trace16", "trace36"])
def test_real_traces_without_a_posed_reading(shared_data: Path, name: str) -> None:
    with pytest.raises(BadInput, match="not one reading with a pose"):
        import_comp4807(shared_data / "comp4807" / f"{name}.trc")
