"""The viewer as a process of ours: started quiet and local, waited for, and ended with its context.

Ports that are free when they are asked for may be taken a moment later, so a viewer that ends
before it listens is started again on other ports.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence

from recorder.errors import BadInput
from replay.rrd.program import LOCAL, free_ports, is_listening, viewer_environment, viewer_program

NEEDS_DRIVER = "no Vulkan driver for the viewer: sudo apt install mesa-vulkan-drivers"
_START_S = 120.0  # generous: a loaded machine takes its time, and a viewer that ends is noticed
_END_S = 10.0
_ATTEMPTS = 3

Arguments = Callable[[Sequence[int]], Sequence[str]]


class ViewerProcess:
    """A viewer that listens on ``ports`` of this machine.

    ``arguments(ports)`` are those of its command line besides ``--bind``; ``count`` is how many
    ports it needs; in its ``own_session`` no Ctrl-C of ours reaches it. Raises BadInput, with the
    last line of its log, when it does not start.
    """

    def __init__(self, arguments: Arguments, count: int, *, own_session: bool = False) -> None:
        for attempt in range(_ATTEMPTS):
            self.ports = free_ports(count)
            self._log = tempfile.TemporaryFile()  # noqa: SIM115 (closed by stop)
            self._process = subprocess.Popen(
                [str(viewer_program()), "--bind", LOCAL, *arguments(self.ports)],
                env=viewer_environment(), stdin=subprocess.DEVNULL, stdout=self._log,
                stderr=subprocess.STDOUT,
                start_new_session=own_session and sys.platform != "win32",
            )  # fmt: skip
            try:
                self._wait_until_listening()
                return
            except BaseException as error:
                log = self._logged()
                self.stop()
                if not isinstance(error, BadInput) or attempt == _ATTEMPTS - 1 or _final(log):
                    raise

    @property
    def process_id(self) -> int:
        """Of the viewer."""
        return self._process.pid

    def check(self) -> None:
        """Raises BadInput, with the reason, when the viewer has ended."""
        if self._process.poll() is not None:
            raise BadInput(self._why_not())

    def wait(self) -> None:
        """Until the viewer ends."""
        self._process.wait()

    def stop(self) -> None:
        """End the viewer."""
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()

    def _wait_until_listening(self) -> None:
        for _ in until(_START_S):
            self.check()
            if all(is_listening(port) for port in self.ports):
                return
        raise BadInput("the viewer did not start in time")

    def _logged(self) -> str:
        self._log.seek(0)
        return self._log.read().decode(errors="replace")

    def _why_not(self) -> str:
        log = self._logged()
        if _final(log):
            return NEEDS_DRIVER
        lines = log.strip().splitlines() or ["it gave no reason"]
        return f"the viewer stopped: {lines[-1]}"


def _final(log: str) -> bool:
    """Whether starting it again cannot help: there is nothing to draw with."""
    return "adapter" in log.lower()


def until(seconds: float) -> Iterator[None]:
    """Once every tenth of a second, until the time is over; once at least."""
    end = time.monotonic() + seconds
    while True:
        yield
        if time.monotonic() >= end:
            return
        time.sleep(0.1)
