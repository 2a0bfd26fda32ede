"""Logs of lidars, sonar rings, text files → messages: what comes out, when, what is refused."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import echogrid
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.importers import Imported, guess_format, import_log
from recorder.importers.columns import columns_of_names
from recorder.messages import Odometry, Pose, Range, Scan, Transform
from recorder.odometry import WheelGeometry
from recorder.protocols.csv import Column
from recorder.protocols.rows import RowField, fields_of


def scans(found: Imported) -> list[Scan]:
    return [message for _, message in found.records if isinstance(message, Scan)]


def ranges(found: Imported) -> list[Range]:
    return [message for _, message in found.records if isinstance(message, Range)]


def text_file(folder: Path, text: str, name: str = "log.txt") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def flaser(ranges_m: list[float], pose: str, odom: str, time_s: float) -> str:
    numbers = " ".join(f"{r:g}" for r in ranges_m)
    return f"FLASER {len(ranges_m)} {numbers} {pose} {odom} {time_s} host {time_s}\n"


@pytest.mark.parametrize(("count", "step_deg"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_carmen_beams_from_right_to_left(tmp_path: Path, count: int, step_deg: float) -> None:
    path = text_file(tmp_path, "# CARMEN\n" + flaser([1.0] * count, "1 2 0.5", "1 2 0.5", 7.25))
    assert guess_format(path) == "carmen"
    (scan,) = scans(import_log("carmen", [path], {}))
    assert scan.angle_min_rad == pytest.approx(-math.pi / 2)
    assert math.degrees(scan.angle_increment_rad) == pytest.approx(step_deg)
    assert len(scan.ranges_m) == count


def test_carmen_gzip_poses_and_what_saw_nothing(tmp_path: Path) -> None:
    rows = [flaser([2.0, 81.9, 0.0, 3.0], f"{i} 0 0.1", f"{i} 0 0.1", float(i)) for i in range(5)]
    path = tmp_path / "log.gz"
    path.write_bytes(gzip.compress(("ODOM 0 0 0 0 0 0 0 h 0\n" + "".join(rows)).encode()))
    assert guess_format(path) == "carmen"
    found = import_log("carmen", [path], {"start_s": 100.0})
    assert [pose.world_from_base.x_m for _, pose in found.records if isinstance(pose, Pose)] == [
        0.0, 1.0, 2.0, 3.0, 4.0,
    ]  # fmt: skip
    np.testing.assert_array_equal(scans(found)[0].ranges_m, [2.0, math.inf, 0.0, 3.0])
    assert [scan.t_ns for scan in scans(found)] == [100_000_000_000 + i * 10**9 for i in range(5)]
    assert found.dropped == {"ODOM line (scans carry their poses)": 1}


def test_a_laser_ahead_of_the_centre_is_a_mount(tmp_path: Path) -> None:
    text = "".join(
        flaser([1.0, 2.0], f"{x + 0.3 * math.cos(h)} {0.3 * math.sin(h)} {h}", f"{x} 0 {h}", x)
        for x, h in ((0.0, 0.0), (1.0, 0.5), (2.0, 1.5))
    )
    found = import_log("carmen", [text_file(tmp_path, text)], {})
    (mount,) = [message for _, message in found.records if isinstance(message, Transform)]
    assert mount.parent_from_child.x_m == pytest.approx(0.3)
    poses = [message.world_from_base for _, message in found.records if isinstance(message, Pose)]
    assert [pose.x_m for pose in poses] == [0.0, 1.0, 2.0]
    assert not any(isinstance(message, Odometry) for _, message in found.records)


def test_corrected_poses_stand_beside_dead_reckoning(tmp_path: Path) -> None:
    text = "".join(flaser([1.0, 2.0], f"{x} 0 0", f"{1.2 * x} 0.1 0", x) for x in (0.0, 1.0, 2.0))
    found = import_log("carmen", [text_file(tmp_path, text)], {})
    poses = [message.world_from_base for _, message in found.records if isinstance(message, Pose)]
    odometry = [m.odom_from_base for _, m in found.records if isinstance(m, Odometry)]
    assert [pose.x_m for pose in poses] == [0.0, 1.0, 2.0]
    assert [pose.x_m for pose in odometry] == pytest.approx([0.0, 1.2, 2.4])


@pytest.mark.parametrize(
    ("times_s", "expected_s"),
    [
        ([5.0, 6.0, 4.0, 5.0, 6.0, 7.0], [5.0, 6.0, 6.001, 7.001, 8.001, 9.001]),
        ([5.0, 6.0, 6.0, 7.0, 8.0], [5.0, 6.0, 6.001, 7.001, 8.001]),
        ([0.0, 0.0, 0.0, 0.0], [0.0, 0.2, 0.4, 0.6]),
        ([3e-150, 1.0, 1e-80, 2e-90, 0.0], [0.0, 0.2, 0.4, 0.6, 0.8]),
    ],
)
def test_rows_keep_their_order_whatever_the_clock_does(
    tmp_path: Path, times_s: list[float], expected_s: list[float]
) -> None:
    text = "".join(flaser([1.0, 2.0], "0 0 0", "0 0 0", t) for t in times_s)
    found = import_log("carmen", [text_file(tmp_path, text)], {})
    assert [scan.t_ns / 1e9 for scan in scans(found)] == pytest.approx(expected_s)


def test_carmen_damage_is_counted(tmp_path: Path) -> None:
    good = flaser([1.0, 2.0], "0 0 0", "0 0 0", 1.0)
    bad = "FLASER 3 1.0 2.0 0 0\nFLASER x\nFLASER 2 1 2 nan 0 0 0 0 0 1 h 1\nFLASER 99999999999 1\n"
    found = import_log("carmen", [text_file(tmp_path, good + bad)], {})
    assert (len(scans(found)), found.dropped) == (1, {"malformed line": 4})
    packed = tmp_path / "cut.gz"
    packed.write_bytes(gzip.compress((good * 5000).encode())[:-200])
    cut = import_log("carmen", [packed], {})
    assert 0 < len(scans(cut)) < 5000
    assert cut.dropped["end of a damaged gzip file"] == 1
    with pytest.raises(BadInput, match="no scan in it"):
        import_log("carmen", [text_file(tmp_path, "# CARMEN\n")], {})


@pytest.mark.real_data
@pytest.mark.parametrize(("name", "count", "beams"), [("intel", 910, 180), ("orebro", 237, 181)])
def test_real_lidar_logs(shared_data: Path, name: str, count: int, beams: int) -> None:
    path = shared_data / "lidar" / f"{name}-corrected.log.gz"
    found = import_log(guess_format(path), [path], {})
    assert {len(scan.ranges_m) for scan in scans(found)} == {beams}
    assert len(scans(found)) == count
    largest_m = max(scan.ranges_m[np.isfinite(scan.ranges_m)].max() for scan in scans(found))
    assert largest_m < 32.7
    assert all(np.diff([scan.t_ns for scan in scans(found)]) > 0)


@pytest.mark.real_data
def test_the_real_sonar_ring(shared_data: Path) -> None:
    folder = shared_data / "sonar_ring"
    one = import_log("sonar-ring", [folder / "poses.txt"], {})
    two = import_log("sonar-ring", [folder / "measurement.txt", folder / "poses.txt"], {})
    assert one == two
    assert len(ranges(one)) == 8 * 413
    assert guess_format(folder / "measurement.txt") == guess_format(folder / "poses.txt")
    first = [reading.range_m for reading in ranges(one)[:8]]
    assert first == [math.inf, math.inf, 2.32, 2.36, math.inf, math.inf, 2.16, 1.19]


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("t_ms,angle_deg,distance_cm", "t_ms head:deg ping:cm"),
        ("time (s);x [m];y [m];theta (rad);sonar (mm)", "t_s x:m y:m heading:rad sonar:mm"),
        ("millis servo dist", "t_ms head:deg ping:cm"),
        ("t_us,left,right,ir_mm,voltage", "t_us left right ir:mm -"),
        ("x,y,ping_left_cm", "- - ping_left:cm"),
        ("hello,world", None),
    ],
)
def test_columns_by_their_header(header: str, expected: str | None) -> None:
    found = columns_of_names(header)
    shown = found and " ".join(f"{c.name}:{c.unit}" if c.unit else c.name for c in found)
    assert shown == expected


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("12, 52,", [("12", "", ""), ("52", "", "")]),
        ("(1, 2)", [("1", "", ""), ("2", "", "")]),
        ("52cm", [("52", "", "cm")]),
        ("52 cm", [("52", "", "cm")]),
        ("1,5;2,5", [("1.5", "", ""), ("2.5", "", "")]),
        ('"1";"2"', [("1", "", ""), ("2", "", "")]),
        ("ping: 52 cm, dirrs=300mm", [("52", "ping", "cm"), ("300", "dirrs", "mm")]),
        ("t:12 ping:52", [("12", "t", ""), ("52", "ping", "")]),
    ],
)
def test_rows_that_are_nearly_csv(row: str, expected: list[tuple[str, str, str]]) -> None:
    assert fields_of(row) == [RowField(*each) for each in expected]


@settings(deadline=None, max_examples=300)
@given(st.text(max_size=60))
def test_any_row_is_read_or_refused(row: str) -> None:
    try:
        fields = fields_of(row)
    except ValueError:
        return
    assert all(field.unit == "" or len(field.unit) <= 3 for field in fields)


def test_a_servo_sweep_that_stands_still(tmp_path: Path) -> None:
    rows = "\n".join(f"{50 * i},{3 * i - 90},{100 + i}" for i in range(60))
    path = text_file(tmp_path, f"t_ms,angle_deg,ping:cm\n{rows}\n")
    found = import_log("csv", [path], {"pose": SE2(1.0, 2.0, 0.0)})
    assert {m.world_from_base for _, m in found.records if isinstance(m, Pose)} == {SE2(1, 2, 0)}
    assert len(ranges(found)) == 60
    turns = [m.parent_from_child.heading_rad for _, m in found.records
             if isinstance(m, Transform) and not m.static]  # fmt: skip
    assert math.degrees(max(turns)) == pytest.approx(87.0)
    session, export = tmp_path / "s.mcap", tmp_path / "out"
    assert echogrid.main(["import", str(path), "-o", str(session)]) == 0
    assert echogrid.main(["map", str(session), "-o", "-", "--export", str(export)]) == 0
    points = np.loadtxt(export / "ping.points.csv", delimiter=",", skiprows=1)
    assert np.hypot(*points[0, :2]) == pytest.approx(1.0, abs=0.005)


def test_whole_seconds_are_spread_over_their_rows(tmp_path: Path) -> None:
    """Ten rows a second from the middle of a second on, with a clock of whole seconds."""
    true_s = 100.4 + 0.1 * np.arange(60)
    text = "".join(f"{int(t + 1e-9)},{40 + i % 9}\n" for i, t in enumerate(true_s))
    found = import_log("csv", [text_file(tmp_path, text)], {"columns": "t_s,ping:cm"})
    times_s = np.array([reading.t_ns for reading in ranges(found)]) / 1e9
    np.testing.assert_allclose(times_s - times_s[0], true_s - true_s[0], atol=0.02)


@pytest.mark.parametrize("header", ["", "x,y,ping\n"])
def test_what_cannot_be_guessed_is_shown(tmp_path: Path, header: str) -> None:
    with pytest.raises(BadInput, match=r"cannot be guessed \('.*'\); name them|not one reading"):
        import_log("csv", [text_file(tmp_path, header + "hello\n")], {})


def test_counts_of_wheels_are_not_taken_for_ranges(tmp_path: Path) -> None:
    rows = "".join(f"{100 * i},{64000 + 40 * i},{64000 + 40 * i},40\n" for i in range(20))
    with pytest.raises(BadInput, match=r"cannot be guessed .*--columns"):
        import_log("csv", [text_file(tmp_path, rows)], {})


def test_rows_that_do_not_fit_are_counted_and_shown(tmp_path: Path) -> None:
    path = text_file(tmp_path, "0,40\n50,forty\n100,41\n")
    found = import_log("csv", [path], {"columns": "t_ms,ping:cm"})
    assert found.dropped == {"malformed row": 1}
    assert found.metadata["first_bad_row"] == "'50,forty'"
    with pytest.raises(BadInput, match=r"not one reading .* did not fit: '1 \?1 1'"):
        import_log(
            "csv", [text_file(tmp_path, "1 \x1b1 1\n")], {"columns": "t_ms,ping:cm,left,right"}
        )


CASES = {
    "epoch_s": (60, 0.0), "nan_only": (40, 0.0), "seconds_int": (100, 0.0),
    "trailing_comma": (60, 0.0), "cr_only": (120, 0.0), "units_glued": (60, 0.0),
    "millis_wrap": (60, 0.0),
}  # fmt: skip


@pytest.mark.real_data
@pytest.mark.parametrize("name", CASES)
def test_text_cases(shared_cases: Path, name: str) -> None:
    path = shared_cases / f"{name}.txt"
    found = import_log(guess_format(path), [path], {})
    rows = [line for line in path.read_text().splitlines() if line.strip()]
    pings = [reading for reading in ranges(found) if reading.sensor == "ping"]
    assert len(pings) + found.dropped.get("not measured", 0) == len(rows)
    assert "malformed row" not in found.dropped
    assert all(0.15 < reading.range_m < 0.95 for reading in pings)


def test_column_table_is_open_to_microseconds() -> None:
    assert Column("t_us").scale == pytest.approx(1e-3)


def test_wheels_make_odometry(tmp_path: Path) -> None:
    rows = "".join(f"{100 * i},{100 * i},{100 * i},40\n" for i in range(20))
    options = {"columns": "t_ms,left,right,ping:cm", "wheels": WheelGeometry(1000.0, 0.3)}
    found = import_log("csv", [text_file(tmp_path, rows)], options)
    odometry = [m.odom_from_base for _, m in found.records if isinstance(m, Odometry)]
    assert odometry[-1].x_m == pytest.approx(1.9)
    with pytest.raises(BadInput, match="wheel counts need --wheels"):
        import_log("csv", [text_file(tmp_path, rows)], {"columns": options["columns"]})
