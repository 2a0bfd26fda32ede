"""The simulated robot in real time, behind a real serial line, with an overhead tracker on TCP.

Whoever records it cannot distinguish it from hardware: the line is a pseudo-terminal that carries
one of the protocols, and it can be made noisy, unplugged and restarted.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from recorder.errors import BadInput, LinkError
from recorder.geometry import SE2
from recorder.messages import Pose, Scan, Transform
from recorder.protocols.echogrid import PROTOCOL_VERSION
from recorder.protocols.reports import HelloReport, LogReport, Report
from recorder.sensors import DEFAULT_SENSORS
from recorder.simulator.firmwares import FIRMWARES, Firmware
from recorder.simulator.robot import Robot
from recorder.simulator.rooms import Room
from recorder.simulator.tracker_server import TrackerServer

if TYPE_CHECKING:
    from recorder.simulator.pseudo_terminal import PseudoTerminal

__all__ = ["HELLO", "HELLO_PERIOD_NS", "Firmware", "SerialRobot"]

HELLO = HelloReport(PROTOCOL_VERSION, "simulated", "echogrid")
HELLO_PERIOD_NS = 5_000_000_000
_CORRUPTION_STREAM = 99  # random numbers of its own, apart from those of the robot
_LONGEST_WAIT_S = 0.02  # between two looks at who connects to the tracker


class SerialRobot:
    """A robot to record from, alive between ``__enter__`` and ``__exit__``.

    ``device`` is the path of its serial port, ``tracker_url`` where its overhead tracker listens
    (``tcp://127.0.0.1:PORT``; JSON lines with ``t_s`` in UNIX seconds, metres and degrees).

    ``speed`` is how many simulated seconds pass in a real one: all stamps are in real time, so a
    fast robot drives and measures faster. ``corrupt_rate`` is the share of bytes that arrive
    wrong. ``device`` may name the path to use; otherwise it lies in a temporary folder.
    ``protocol`` is that of its line: ``echogrid``, ``rbc`` or ``csv``.

    Raises BadInput for what :class:`~recorder.simulator.robot.Robot` refuses, for a lidar (the
    protocol has no scans) and for numbers out of range; LinkError, when entered,
    where the system has no pseudo-terminals.
    """

    device: str
    tracker_url: str

    def __init__(
        self,
        room: Room,
        *,
        seed: int = 0,
        noise: float = 1.0,
        sensors: Sequence[str] = DEFAULT_SENSORS,
        route: NDArray[np.float64] | None = None,
        head_sweep_deg: float = 0.0,
        speed: float = 1.0,
        corrupt_rate: float = 0.0,
        device: str | Path | None = None,
        protocol: str = Firmware.protocol,
    ) -> None:
        if protocol not in FIRMWARES:
            known = ", ".join(FIRMWARES)
            raise BadInput(f"the protocols of the simulated robot are {known}, not {protocol!r}")
        if protocol != Firmware.protocol and not set(sensors) <= set(DEFAULT_SENSORS):
            raise BadInput(f"the protocol {protocol} carries only {', '.join(DEFAULT_SENSORS)}")
        if not 0.01 <= speed <= 100.0:
            raise BadInput(f"the speed must be between 0.01 and 100, not {speed:g}")
        if not 0.0 <= corrupt_rate <= 1.0:
            raise BadInput(f"the share of bad bytes must be between 0 and 1, not {corrupt_rate:g}")
        self._robot = Robot(
            room,
            seed=seed,
            noise=noise,
            sensors=sensors,
            route=route,
            head_sweep_deg=head_sweep_deg,
        )
        if any(kind.scan is not None for kind in self._robot.kinds.values()):
            raise BadInput("the echogrid protocol has no scans: the serial robot has no lidar")
        self._speed = speed
        rng = np.random.default_rng([seed, _CORRUPTION_STREAM])
        self._firmware = FIRMWARES[protocol](corrupt_rate, rng)
        self._wanted_device = device
        self._resources = ExitStack()
        self._stop, self._reboot = threading.Event(), threading.Event()
        self._plug = threading.Lock()
        self._terminal: PseudoTerminal | None = None
        self._sent = self._losses = 0

    @property
    def counts(self) -> dict[str, int]:
        """Lines ``sent``; ``losses``: how many found no plug, or unread lines that had to go."""
        return {"sent": self._sent, "losses": self._losses}

    def __enter__(self) -> Self:
        with ExitStack() as resources:
            if self._wanted_device is None:
                folder = resources.enter_context(tempfile.TemporaryDirectory(prefix="echogrid-"))
                self.device = str(Path(folder) / "robot")
            else:
                self.device = str(self._wanted_device)
            self._tracker = TrackerServer()
            resources.callback(self._tracker.close)
            self.tracker_url = self._tracker.url
            self.replug()
            resources.callback(self.unplug)
            thread = threading.Thread(target=self._live, name="simulated robot", daemon=True)
            thread.start()
            resources.callback(thread.join)
            resources.callback(self._stop.set)
            self._resources = resources.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._resources.close()

    def mounts(self) -> dict[str, tuple[str, SE2]]:
        """The frame that carries each sensor, and where it sits there."""
        return self._robot.mounts()

    def mount_transforms(self) -> tuple[Transform, ...]:
        """The mounts as messages, for whoever records the line."""
        return tuple(
            Transform(0, parent, sensor, parent_from_sensor)
            for sensor, (parent, parent_from_sensor) in self.mounts().items()
        )

    def unplug(self) -> None:
        """Pull the plug: whoever reads sees the line hang up. The robot drives on."""
        with self._plug:
            if self._terminal is not None:
                self._terminal.close()
                self._terminal = None

    def replug(self) -> None:
        """Plug it in again, under the same ``device``."""
        try:
            from recorder.simulator.pseudo_terminal import PseudoTerminal
        except ImportError:  # Windows
            raise LinkError("a simulated serial line needs Linux or macOS") from None
        with self._plug:
            if self._terminal is None:
                self._terminal = PseudoTerminal(Path(self.device))

    def restart(self) -> None:
        """Reset the device: sequence numbers, its clock and its counts begin at 0 again."""
        self._reboot.set()

    def _live(self) -> None:
        """The robot's thread."""
        wall_ns, steady_ns = time.time_ns(), time.monotonic_ns()
        next_hello_ns = 0
        self._reboot.set()
        for event in self._robot.events():
            log_ns, t_ns = round(event.log_ns / self._speed), round(event.t_ns / self._speed)
            if not self._wait_until(steady_ns + log_ns):
                return
            if self._reboot.is_set():
                self._reboot.clear()
                self._firmware.boot(log_ns)
                self._transmit(HELLO, log_ns)
                self._transmit(LogReport("boot"), log_ns)
                next_hello_ns = log_ns + HELLO_PERIOD_NS
            if log_ns >= next_hello_ns:
                self._transmit(HELLO, log_ns)
                next_hello_ns += HELLO_PERIOD_NS
            match event.report:
                case Pose(_, world_from_base):
                    self._tracker.send((wall_ns + t_ns) * 1e-9, world_from_base)
                case Scan():
                    raise AssertionError("a robot without a lidar sent a scan")
                case report:
                    self._transmit(report, t_ns)

    def _wait_until(self, due_ns: int) -> bool:
        """Look after the connections until it is time; False when the robot is to stop."""
        while not self._stop.is_set():
            self._tracker.accept()
            self._answer()
            wait_s = (due_ns - time.monotonic_ns()) * 1e-9
            if wait_s <= 0.0:
                return True
            self._stop.wait(min(wait_s, _LONGEST_WAIT_S))
        return False

    def _transmit(self, report: Report, t_ns: int) -> None:
        line = self._firmware.line(report, t_ns)
        if not line:
            return
        self._sent += 1  # before the write: whoever has read a line finds it counted
        with self._plug:
            taken = False
            if self._terminal is not None:
                taken = self._terminal.write(line, time.monotonic_ns())
        self._losses += not taken

    def _answer(self) -> None:
        """Take what the host sent, so that its line never fills up, and answer it."""
        with self._plug:
            if self._terminal is not None:
                answer = self._firmware.receive(self._terminal.read_input())
                if answer:
                    self._terminal.write(answer, time.monotonic_ns())
