"""The firmware on a simulated chip: what leaves its serial line, and the map that comes of it."""

from __future__ import annotations

import itertools
import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from simulated_board import (
    BUILD,
    FIRMWARE,
    ROOT,
    RoomWorld,
    SimulatedBoard,
    World,
    infrared_mv,
    listening,
)

from recorder.messages import Diagnostics, Odometry, Pose, Range
from recorder.protocols.echogrid import DEVICE_MS_RANGE, EchogridProtocol
from recorder.protocols.reports import (
    HeadReport,
    HelloReport,
    LogReport,
    Packet,
    RangeReport,
    WheelReport,
)
from recorder.session import read_session
from recorder.simulator.rooms import load_room

PACKAGES = {
    "gcc-avr": "/usr/bin/avr-gcc",
    "avr-libc": "/usr/lib/avr/include/avr/io.h",
    "libsimavr-dev": "/usr/include/simavr/sim_avr.h",
    "libelf-dev": "/usr/include/libelf.h",
    "arduino-core-avr": "/usr/share/arduino/hardware/arduino/avr/cores/arduino/Arduino.h",
}
FLASH_BYTES, RAM_BYTES = 32_256, 2048  # of an Uno, its boot loader aside
FRAME_S = 0.05

Make = Callable[..., Path]


@pytest.fixture(scope="session")
def make(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Makes a target of firmware/Makefile with options of the compiler; the file that came."""
    missing = [package for package, file in PACKAGES.items() if not Path(file).exists()]
    missing += [tool for tool in ("make", "gcc") if shutil.which(tool) is None]
    if missing:
        reason = f"the simulated chip needs: sudo apt install {' '.join(missing)}"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("firmware")

    def run(target: str, options: str = "") -> Path:
        build = folder / (re.sub(r"\W", "", options) or "plain")
        command = ["make", "-C", str(FIRMWARE), f"BUILD={build}", f"OPTIONS={options}"]
        done = subprocess.run(
            [*command, str(build / target)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning" not in done.stderr, done.stderr
        return build / target

    return run


class Scripted(World):
    """Ranges by the time alone; wheels that follow a function."""

    def __init__(
        self,
        sonar_m: Callable[[float], float | None] = lambda t_s: 1.0,
        infrared_m: Callable[[float], float] = lambda t_s: 0.3,
        wheels: Callable[[float], tuple[int, int]] = lambda t_s: (0, 0),
    ) -> None:
        self._sonar_m, self._infrared_m, self._wheels = sonar_m, infrared_m, wheels
        self.asked: list[tuple[float, float | None]] = []
        self.heads: list[tuple[float, float]] = []

    def tick(self, t_s: float, head_rad: float) -> None:
        self.heads.append((t_s, head_rad))

    def sonar_m(self, t_s: float, head_rad: float) -> float | None:
        self.asked.append((t_s, self._sonar_m(t_s)))
        return self.asked[-1][1]

    def infrared_m(self, t_s: float, head_rad: float) -> float:
        return self._infrared_m(t_s)

    def wheels(self, t_s: float) -> tuple[int, int]:
        return self._wheels(t_s)


def packets_of(
    make: Make,
    world: World,
    seconds: float,
    *,
    firmware: str = "Robot.elf",
    options: str = "",
    wires: int = 2,
    after: Callable[[SimulatedBoard], None] | None = None,
) -> list[Packet]:
    """What the chip sends in so many of its seconds."""
    elf = make(firmware, options)
    with SimulatedBoard(make("board"), elf, world, wires=wires, speed=50.0) as board:
        with listening(board.device) as received:
            board.power_on()
            board.run_until(seconds)
            if after is not None:
                after(board)
            load = board.stop()
        assert load.longest_us < 5000 or firmware != "Robot.elf"
    protocol = EchogridProtocol()
    return [*protocol.feed(bytes(received)), *protocol.close()]


def whole(packets: list[Packet]) -> list[Packet]:
    """All but the last, which the end may have cut; every one of them is sound."""
    assert all(packet.fault is None for packet in packets[:-1]), packets
    return packets[:-1]


def ranges(packets: list[Packet], sensor: str) -> list[tuple[float, float]]:
    """Times in seconds and ranges of one sensor."""
    return [
        (packet.device_ms / 1000.0, packet.report.range_m)
        for packet in packets
        if isinstance(packet.report, RangeReport) and packet.report.sensor == sensor
    ]


def texts(packets: list[Packet]) -> list[str]:
    return [packet.report.text for packet in packets if isinstance(packet.report, LogReport)]


@pytest.mark.parametrize("wires", [1, 2])
def test_ranges_are_within_a_centimetre_up_to_three_metres(make: Make, wires: int) -> None:
    world = Scripted(sonar_m=lambda t_s: 0.021 + (t_s * 0.61803) % 1.0 * 2.979)
    packets = whole(
        packets_of(make, world, 8.0, options=f"-DSONAR_HAS_ONE_WIRE={2 - wires}", wires=wires)
    )
    measured = ranges(packets, "ping")
    true = [range_m for _, range_m in world.asked][: len(measured)]
    assert min(true) < 0.1
    assert max(true) > 2.9
    assert len(measured) >= 150  # 7.6 s at 20 a second
    assert np.allclose(np.diff([t_s for t_s, _ in measured]), FRAME_S, atol=0.011)
    errors_m = np.array([range_m for _, range_m in measured]) - true
    assert np.abs(errors_m).max() < 0.01
    assert np.abs(errors_m).max() <= 0.001  # what half a millimetre of rounding explains
    # Each is dated by the moment at which the sound met the obstacle.
    met_s = [t_s + range_m / 343.42 for t_s, range_m in world.asked][: len(measured)]
    assert np.abs(np.array([t_s for t_s, _ in measured]) - met_s).max() < 0.002


@pytest.mark.parametrize("wires", [1, 2])
@pytest.mark.parametrize("special_m", [math.inf, -math.inf])
def test_no_echo_and_one_too_close(make: Make, wires: int, special_m: float) -> None:
    world = Scripted(sonar_m=lambda t_s: special_m, infrared_m=lambda t_s: special_m)
    options = f"-DSONAR_HAS_ONE_WIRE={2 - wires}"
    packets = whole(packets_of(make, world, 1.5, options=options, wires=wires))
    for sensor in ("ping", "dirrs"):
        measured = ranges(packets, sensor)
        assert len(measured) >= 16
        assert {range_m for _, range_m in measured} == {special_m}


def test_infrared_ranges_follow_the_data_sheet(make: Make) -> None:
    def stairs(t_s: float) -> float:
        return 0.11 + 0.06 * (int(t_s * 5.0) % 12)

    packets = whole(packets_of(make, Scripted(infrared_m=stairs), 3.5))
    measured = [(t_s + 0.043, range_m) for t_s, range_m in ranges(packets, "dirrs")]
    settled = [(t_s, r) for t_s, r in measured if stairs(t_s - 0.004) == stairs(t_s + 0.006)]
    assert len({stairs(t_s) for t_s, _ in settled}) == 12
    for t_s, range_m in settled:
        assert range_m == pytest.approx(stairs(t_s), rel=0.04)
    assert infrared_mv(0.2) > infrared_mv(0.4)


def test_wheels_count_every_step_both_ways(make: Make) -> None:
    def wheels(t_s: float) -> tuple[int, int]:
        return round(800.0 * math.sin(2.0 * t_s)), round(-2500.0 * t_s)

    packets = whole(packets_of(make, Scripted(wheels=wheels), 3.0))
    counts = [
        (packet.device_ms / 1000.0, packet.report)
        for packet in packets
        if isinstance(packet.report, WheelReport)
    ]
    assert len(counts) >= 48
    for t_s, report in counts:
        for counted, rate, truth in zip(
            (report.left, report.right), (1600.0, 2500.0), wheels(t_s), strict=True
        ):
            signed = (counted + 2**15) % 2**16 - 2**15
            assert abs(signed - truth) <= 2 + 0.004 * rate  # the stamp and the steps: 4 ms
    assert not any("wheels" in text for text in texts(packets))


def test_the_head_looks_where_its_lines_place_it(make: Make) -> None:
    world = Scripted()
    packets = whole(packets_of(make, world, 5.0))
    reported = [
        (packet.device_ms / 1000.0, packet.report.angle_rad)
        for packet in packets
        if isinstance(packet.report, HeadReport)
    ]
    t_s, head_rad = np.array(world.heads).T
    angles_deg = np.degrees([angle for _, angle in reported])
    assert angles_deg.min() < -55.0
    assert angles_deg.max() > 55.0
    true_deg = np.degrees(np.interp([t for t, _ in reported], t_s, head_rad))
    assert np.abs(angles_deg - true_deg)[10:].max() < 2.5  # a step of the servo, and 15 ms


def test_what_the_robot_lacks_is_not_mentioned(make: Make) -> None:
    options = "-DHEAD_SWEEP_DEG=0 -DHAS_INFRARED=0"
    packets = whole(packets_of(make, Scripted(), 1.0, options=options))
    assert len(ranges(packets, "ping")) >= 10
    assert ranges(packets, "dirrs") == []
    assert not any(isinstance(packet.report, HeadReport) for packet in packets)


def test_it_reports_its_name_and_why_it_booted(make: Make) -> None:
    def shake(board: SimulatedBoard) -> None:
        board.press_reset()
        board.run_until(7.0)
        board.brown_out()
        board.run_until(7.5)

    packets = packets_of(make, Scripted(), 6.0, after=shake)
    hellos = [packet for packet in packets if isinstance(packet.report, HelloReport)]
    assert [packet.report for packet in hellos] == 4 * [HelloReport(1, "arduino", "echogrid-1.0")]
    assert [packet.device_ms // 100 for packet in hellos] == [0, 50, 0, 0]
    assert texts(packets) == [
        "boot, power on", "boot, reset", "boot, brown-out: the supply broke down",
    ]  # fmt: skip
    assert sum(packet.fault is not None for packet in packets) <= 3  # what a boot cut


@pytest.mark.parametrize(
    ("wires", "sonar_m", "words"),
    [
        (2, None, "sonar: no pulse on pin 8"),
        (1, None, "sonar: no pulse on pin 8"),
        (2, math.nan, "sonar: pin 8 stays high"),
    ],
)
def test_what_is_wrong_with_the_sonar_is_reported(
    make: Make, wires: int, sonar_m: float | None, words: str
) -> None:
    options = f"-DSONAR_HAS_ONE_WIRE={2 - wires}"
    world = Scripted(sonar_m=lambda t_s: sonar_m)
    packets = whole(packets_of(make, world, 5.3, options=options, wires=wires))
    assert texts(packets)[1:] == [words]
    assert {range_m for _, range_m in ranges(packets, "ping")} <= {math.inf}
    assert (sonar_m is None) == (ranges(packets, "ping") == [])
    assert len(ranges(packets, "dirrs")) >= 90


def test_clock_and_numbers_go_round(make: Make) -> None:
    options = f"-DCLOCK_AT_BOOT_MS={DEVICE_MS_RANGE - 2000}UL -DSEQ_AT_BOOT=65450"
    packets = whole(packets_of(make, Scripted(), 4.0, options=options))
    times_ms = np.array([packet.device_ms for packet in packets])
    seqs = np.array([packet.seq for packet in packets])
    assert times_ms.max() > DEVICE_MS_RANGE - 100
    assert (times_ms < 2000).any()
    assert set(np.diff(seqs) % 2**16) == {1}
    pings_s = [t_s for t_s, _ in ranges(packets, "ping")]
    steps_s = np.diff(pings_s) % (DEVICE_MS_RANGE / 1000.0)
    assert np.allclose(steps_s, FRAME_S, atol=0.002)
    heads = [p.report.angle_rad for p in packets if isinstance(p.report, HeadReport)]
    assert np.degrees(np.abs(np.diff(heads)).max()) < 4.0  # the sweep goes on where it was


def test_it_fits_the_chip(make: Make) -> None:
    words = subprocess.run(
        ["avr-size", str(make("Robot.elf"))], capture_output=True, text=True, check=True
    ).stdout.split()
    text, data, bss = (int(word) for word in words[6:9])
    page = (ROOT / "docs" / "firmware.md").read_text("utf-8")
    flash, ram = (int(n) for n in re.findall(r"(?:flash|RAM) *\| *(\d+) bytes", page))
    assert text + data < FLASH_BYTES / 4
    assert data + bss < RAM_BYTES / 2
    assert flash == pytest.approx(text + data, rel=0.1)  # of another compiler, too
    assert ram == pytest.approx(data + bss, rel=0.1)


@pytest.mark.parametrize(
    ("sketch", "sensor", "true_m", "tolerance_m"),
    [("Sonar", "ping", 1.0, 0.015), ("Infrared", "dirrs", 0.3, 0.01)],
)
def test_the_examples_on_the_arduino_core(
    make: Make, sketch: str, sensor: str, true_m: float, tolerance_m: float
) -> None:
    packets = whole(packets_of(make, Scripted(), 2.0, firmware=f"{sketch}.elf"))
    measured = ranges(packets, sensor)[1:]  # before the first, millis() has only just begun
    assert len(measured) >= 30
    assert all(abs(range_m - true_m) < tolerance_m for _, range_m in measured), measured
    assert isinstance(packets[0].report, HelloReport)
    assert [packet.seq for packet in packets] == list(range(len(packets)))


def test_the_robot_on_the_arduino_core(make: Make) -> None:
    packets = whole(packets_of(make, Scripted(), 1.5, firmware="Robot-arduino.elf"))
    assert {range_m for _, range_m in ranges(packets, "ping")} <= {0.999, 1.0, 1.001}
    assert len(ranges(packets, "dirrs")) >= 18


@pytest.fixture(scope="module")
def drive(make: Make, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A drive of 30 s through the room, with a reset in the middle: recorded, and mapped."""
    folder = tmp_path_factory.mktemp("drive")
    session, maps = folder / "run.mcap", folder / "maps"
    world = RoomWorld(load_room("room"), seed=1, noise=0.5)
    with SimulatedBoard(make("board"), make("Robot.elf"), world) as board:
        recorder = subprocess.Popen(
            [*ECHOGRID, "record", board.device, "-o", str(session), "--quiet",
             "--tracker", world.tracker.url, "--duration", "36", *BUILD],
            env=ENVIRONMENT,
        )  # fmt: skip
        started_s = time.monotonic()
        while not world.tracker.clients and time.monotonic() - started_s < 60.0:
            world.tracker.accept()
            time.sleep(0.02)
        board.power_on()
        board.run_until(15.0)
        board.press_reset()
        assert recorder.wait(120) in (0, 1)  # 1: the reset cut a line
        board.stop()
    subprocess.run(
        [*ECHOGRID, "map", str(session), "-o", "-", "--export", str(maps), "--quiet"],
        check=True, env=ENVIRONMENT,
    )  # fmt: skip
    return session, maps


ECHOGRID = (sys.executable, "-m", "echogrid")
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


def test_the_reset_costs_only_a_moment(drive: tuple[Path, Path]) -> None:
    session = read_session(drive[0])
    counts = [m for m in session.messages() if isinstance(m, Diagnostics)][-1]
    values = {name: int(value) for name, value in counts.counters.items() if str(value).isdigit()}
    assert values["device_restarts"] == 1
    assert values["gaps"] == 0
    assert sum(values.get(name, 0) for name in ("bad_checksum", "malformed", "overlong")) == 0
    assert values.get("cut", 0) + values.get("noise", 0) <= 1  # the line that the reset cut
    pings_s = [m.t_ns / 1e9 for m in session.messages() if isinstance(m, Range)]
    assert len(pings_s) > 2 * 20 * 28
    longest_s = np.diff(np.sort(pings_s)).max()
    assert longest_s < 0.8  # 0.4 s to settle, and a frame
    odometry = [m for m in session.messages() if isinstance(m, Odometry)]
    steps_m = [
        math.hypot(b.odom_from_base.x_m - a.odom_from_base.x_m,
                   b.odom_from_base.y_m - a.odom_from_base.y_m)
        for a, b in itertools.pairwise(odometry)
    ]  # fmt: skip
    assert max(steps_m) < 0.05  # the counts began at 0 again, and nothing jumped


def test_readings_are_dated_to_the_millisecond(drive: tuple[Path, Path]) -> None:
    """Seen from the tracker's poses: the wheels' turns and its own happen at the same time."""
    session = read_session(drive[0])
    poses = [m for m in session.messages() if isinstance(m, Pose)]
    odometry = [m for m in session.messages() if isinstance(m, Odometry)]
    pose_s = np.array([m.t_ns for m in poses]) / 1e9
    odom_s = np.array([m.t_ns for m in odometry]) / 1e9
    turned = np.unwrap([m.world_from_base.heading_rad for m in poses])
    counted = np.unwrap([m.odom_from_base.heading_rad for m in odometry])
    before_reset = pose_s[0] + 14.5

    def disagreement(shift_s: float) -> float:
        inside = (pose_s > odom_s[0] + 0.5) & (pose_s < before_reset)
        difference = turned[inside] - np.interp(pose_s[inside] + shift_s, odom_s, counted)
        return float(np.std(difference))

    shifts_s = np.arange(-0.2, 0.2, 0.005)
    best_s = shifts_s[np.argmin([disagreement(shift_s) for shift_s in shifts_s])]
    assert abs(best_s) <= 0.02


def test_the_walls_stand_where_the_room_has_them(drive: tuple[Path, Path]) -> None:
    layer = np.load(drive[1] / "dirrs.npz")
    rows, columns = np.nonzero(layer["values"] > 0.55)
    cells_m = layer["origin_m"] + (np.column_stack([columns, rows]) + 0.5) * layer["resolution_m"]
    walls_m = np.concatenate([
        a + (b - a) * np.linspace(0.0, 1.0, 400)[:, None] for a, b in load_room("room").walls_m
    ])  # fmt: skip
    assert len(cells_m) > 1000

    def near(points_m: np.ndarray, others_m: np.ndarray) -> float:
        return float((cKDTree(others_m).query(points_m)[0] < 0.05).mean())

    assert near(cells_m, walls_m) > 0.8
    assert near(walls_m, cells_m) > 0.5  # one lap takes longer than 30 s
    assert near(cells_m + 0.1, walls_m) < 0.5  # elsewhere they would not fit
