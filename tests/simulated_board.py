"""An Arduino that is not there: the firmware, compiled, on a simulated chip, in a simulated room.

The chip is simavr's (``firmware/board``). Its echo pin, its analogue input and its encoders follow
a :class:`World`; its serial line is a pseudo-terminal. As a command it waits to be recorded::

    make -C firmware all board
    python tests/simulated_board.py room
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import subprocess
import sys
import threading
import time
import tty
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from recorder.geometry import SE2
from recorder.sensors import CATALOGUE, DEFAULT_SENSORS
from recorder.simulator.drive import Drive
from recorder.simulator.echoes import range_reading
from recorder.simulator.robot import WHEELS
from recorder.simulator.rooms import Room, load_room
from recorder.simulator.tracker_server import TrackerServer

ROOT = Path(__file__).resolve().parent.parent
FIRMWARE = ROOT / "firmware"

SOUND_MPS = 331.3 + 0.606 * 20.0  # in air of 20 degrees
ECHO_DELAY_US = {1: 750, 2: 460}  # by the wires of the sonar: from the trigger to the pulse
STUCK_US = 200_000  # what some copies do when no echo comes
RESET, END, BROWN_OUT = 1, 2, 3  # commands to `firmware/board`
NO_ECHO_US = {1: 18_500, 2: 38_000}
SERVO_AHEAD_US, SERVO_US_PER_RAD = 1500.0, 1000.0 / math.radians(90.0)
SERVO_RADPS = math.radians(300.0)
INFRARED_CYCLE_S, INFRARED_DELAY_S = 0.0383, 0.005
POSE_PERIOD_S, POSE_ERROR_M, POSE_ERROR_RAD = 0.1, 0.003, math.radians(1.0)
# Options of `record`: how this robot is built.
WHEEL_RADIUS_M = 0.032
BUILD = (
    f"--wheels={WHEEL_RADIUS_M},{WHEELS.track_m},"
    f"{WHEELS.ticks_per_m * 2.0 * math.pi * WHEEL_RADIUS_M}",
    "--mount=ping@head=0.044,0,0",
    "--mount=dirrs@head=-0.0312,0,0",
)


class World:
    """What surrounds the chip: by default nothing, and the wheels stand still."""

    def tick(self, t_s: float, head_rad: float) -> None:
        """Called each 2 ms of the chip's time, with where its servo points."""

    def sonar_m(self, t_s: float, head_rad: float) -> float | None:
        """A range; +Inf: no echo, -Inf: too close, NaN: stuck; None: there is no sonar."""
        return math.inf

    def infrared_m(self, t_s: float, head_rad: float) -> float:
        """As above: what the ranger shows now."""
        return math.inf

    def wheels(self, t_s: float) -> tuple[int, int]:
        """Quarter steps of the encoders since the start."""
        return 0, 0


class RoomWorld(World):
    """The room simulator's room, drive and echoes, and an overhead tracker beside it."""

    def __init__(self, room: Room, *, seed: int = 0, noise: float = 1.0) -> None:
        self.room = room
        self.drive = Drive(room.route_m, WHEELS.track_m)
        self.tracker = TrackerServer()
        self._noise = noise
        self._rng = {
            name: np.random.default_rng([seed, i]) for i, name in enumerate(DEFAULT_SENSORS)
        }
        self._pose_rng = np.random.default_rng([seed, len(DEFAULT_SENSORS)])
        self._unix_at_boot_s: float | None = None
        self._next_pose_s = 0.0
        self._next_infrared_s = INFRARED_CYCLE_S / 2.0  # in the middle of its measurement
        self._infrared: deque[tuple[float, float]] = deque()  # shown from, range
        self._shown_m = math.inf

    def tick(self, t_s: float, head_rad: float) -> None:
        if self._unix_at_boot_s is None:
            self._unix_at_boot_s = time.time() - t_s
        self.tracker.accept()
        if t_s >= self._next_pose_s:
            self._next_pose_s += POSE_PERIOD_S
            self.tracker.send(self._unix_at_boot_s + t_s, self._seen(t_s))
        if t_s >= self._next_infrared_s:
            shown_s = self._next_infrared_s + INFRARED_CYCLE_S / 2.0 + INFRARED_DELAY_S
            self._infrared.append((shown_s, self._range_m("dirrs", t_s, head_rad)))
            self._next_infrared_s += INFRARED_CYCLE_S

    def sonar_m(self, t_s: float, head_rad: float) -> float:
        return self._range_m("ping", t_s, head_rad)

    def infrared_m(self, t_s: float, head_rad: float) -> float:
        while self._infrared and t_s >= self._infrared[0][0]:
            _, self._shown_m = self._infrared.popleft()
        return self._shown_m

    def wheels(self, t_s: float) -> tuple[int, int]:
        state = self.drive.at(t_s)
        left, right = (math.floor(m * WHEELS.ticks_per_m) for m in (state.left_m, state.right_m))
        return left, right

    def _seen(self, t_s: float) -> SE2:
        true = self.drive.at(t_s).world_from_base
        x, y, turn = self._noise * self._pose_rng.standard_normal(3)
        return SE2(
            true.x_m + POSE_ERROR_M * x, true.y_m + POSE_ERROR_M * y,
            true.heading_rad + POSE_ERROR_RAD * turn,
        )  # fmt: skip

    def _range_m(self, name: str, t_s: float, head_rad: float) -> float:
        kind = CATALOGUE[name]
        sensor = self.drive.at(t_s).world_from_base @ SE2(0.0, 0.0, head_rad) @ kind.mount
        return range_reading(self.room.walls_m, sensor, kind, self._noise, self._rng[name])


@dataclass(frozen=True, slots=True)
class Load:
    """How busy the chip was: share of the time awake, and the longest stretch of it."""

    awake: float
    longest_us: int


class SimulatedBoard:
    """A chip that runs ``firmware`` in a world, alive between ``__enter__`` and ``__exit__``.

    It is held at its first instruction until :meth:`power_on`. ``device`` is its serial line.
    ``wires`` are those of its sonar; ``speed`` is how many of its seconds pass in a real one.
    """

    device: str
    load: Load

    def __init__(
        self, board: Path, firmware: Path, world: World, *, wires: int = 2, speed: float = 1.0
    ) -> None:
        self._command = [str(board), str(firmware), str(wires), str(speed)]
        self._world = world
        self._wires = wires
        self._on, self._stop = threading.Event(), threading.Event()
        self._command_once = 0
        self.t_s = 0.0
        self._servo_s = self._head_rad = 0.0

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        assert self._process.stdout is not None
        _, self.device = self._process.stdout.readline().split()
        self._thread = threading.Thread(target=self._answer, name="world", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._stop.set()
        self._on.set()
        self._thread.join(30.0)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.communicate(timeout=10.0)
        self._process.kill()
        self._process.wait()

    def power_on(self) -> None:
        """From now on the chip runs."""
        self._on.set()

    def press_reset(self) -> None:
        """Everything in the chip begins anew; the world goes on."""
        self._command_once = RESET

    def brown_out(self) -> None:
        """The same, because the supply broke down."""
        self._command_once = BROWN_OUT

    def run_until(self, t_s: float) -> None:
        """Returns when the chip's time has come, or it has died."""
        while self.t_s < t_s and self._thread.is_alive():
            time.sleep(0.005)

    def stop(self) -> Load:
        """The end of it; what is still on the line can be read until this block is left."""
        self._stop.set()
        self._thread.join(30.0)
        return self.load

    def _answer(self) -> None:
        """The thread that is asked what happens at the chip's pins."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        for line in self._process.stdout:
            what, first, second = line.split()
            if what == "end":
                self.load = Load(float(first), int(second))
                return
            t_s, pulse_us = int(first) * 1e-6, int(second)
            self._turn_head(t_s, pulse_us)
            if what == "ping":
                answer = self._echo(self._world.sonar_m(t_s, self._head_rad))
            elif what == "analogue":
                answer = str(infrared_mv(self._world.infrared_m(t_s, self._head_rad)))
            else:
                answer = self._tick(t_s)
            with contextlib.suppress(BrokenPipeError):  # it died, and its end follows
                self._process.stdin.write(answer + "\n")

    def _tick(self, t_s: float) -> str:
        self._on.wait()
        self.t_s = t_s
        self._world.tick(t_s, self._head_rad)
        command = END if self._stop.is_set() else self._command_once
        self._command_once = 0
        left, right = self._world.wheels(t_s)
        return f"{left} {right} {command}"

    def _echo(self, range_m: float | None) -> str:
        if range_m is None:
            return "0 0"
        if math.isnan(range_m):
            return f"{ECHO_DELAY_US[self._wires]} {STUCK_US}"
        if math.isinf(range_m):
            width_us = NO_ECHO_US[self._wires] if range_m > 0.0 else 80
        else:
            width_us = round(2e6 * range_m / SOUND_MPS)
        return f"{ECHO_DELAY_US[self._wires]} {min(width_us, NO_ECHO_US[self._wires])}"

    def _turn_head(self, t_s: float, pulse_us: int) -> None:
        """A servo follows its latest pulse, as fast as it can."""
        if pulse_us > 0:
            reach_rad = SERVO_RADPS * (t_s - self._servo_s)
            error_rad = (pulse_us - SERVO_AHEAD_US) / SERVO_US_PER_RAD - self._head_rad
            self._head_rad += min(max(error_rad, -reach_rad), reach_rad)
        self._servo_s = t_s


def infrared_mv(range_m: float) -> int:
    """What a GP2Y0A21 shows: a power law within 3 % of the typical curve of its data sheet."""
    if math.isinf(range_m):
        return 330 if range_m > 0.0 else 2900
    return round(1000.0 * (0.270 / range_m) ** (1.0 / 1.2))


@contextlib.contextmanager
def listening(device: str) -> Iterator[bytearray]:
    """All bytes that arrive on a serial line while the block lasts, and shortly after it."""
    line = os.open(device, os.O_RDONLY | os.O_NOCTTY)
    tty.setraw(line)
    received, done = bytearray(), threading.Event()

    def read() -> None:
        while True:
            if select.select([line], [], [], 0.05)[0]:
                data = b""
                with contextlib.suppress(OSError):  # the other end is gone
                    data = os.read(line, 4096)
                if not data:
                    return
                received.extend(data)
            elif done.is_set():
                return

    thread = threading.Thread(target=read)
    thread.start()
    try:
        yield received
    finally:
        done.set()
        thread.join()
        os.close(line)


def main() -> None:
    """Drive through the room of that name until Ctrl-C."""
    build = FIRMWARE / "build"
    world = RoomWorld(load_room(sys.argv[1] if len(sys.argv) > 1 else "room"))
    with SimulatedBoard(build / "board", build / "Robot.elf", world) as board:
        board.power_on()
        sys.stdout.write(
            f"echogrid live {board.device} --tracker {world.tracker.url} {' '.join(BUILD)}\n"
        )
        sys.stdout.flush()
        with contextlib.suppress(KeyboardInterrupt):
            board.run_until(math.inf)


if __name__ == "__main__":
    main()
