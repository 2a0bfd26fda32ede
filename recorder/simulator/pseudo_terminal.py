"""A serial port without hardware: the device's end of a pseudo-terminal, behind a lasting name.

The name is a symbolic link, as the ones in ``/dev/serial/by-id`` are: when the device is unplugged
and plugged in again, the same name leads to a new terminal.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import sys
import termios
import tty
from pathlib import Path

from recorder.errors import LinkError

LONGEST_WAIT_NS = 2_000_000_000


def unread_bytes(host_fd: int) -> int:
    """How many bytes wait at the host's end of a pseudo-terminal."""
    answer = fcntl.ioctl(host_fd, termios.FIONREAD, bytes(4))
    return int.from_bytes(answer, sys.byteorder)


class PseudoTerminal:
    """The end of a serial line at which the robot sits; ``link`` names the other end.

    Nothing blocks here. What nobody has read for two seconds is thrown away, all of it, as a
    serial port without a listener does: who comes late reads what is new.
    """

    def __init__(self, link: Path) -> None:
        """Raises LinkError when the system gives no terminal, and when ``link`` is taken."""
        try:
            self._device_fd, self._host_fd = os.openpty()
        except OSError as error:
            raise LinkError(f"no pseudo-terminal to be had: {error.strerror}") from None
        self._link = link
        self._empty_ns = 0
        try:
            tty.setraw(self._device_fd)
            tty.setraw(self._host_fd)
            os.set_blocking(self._device_fd, False)
            os.symlink(os.ttyname(self._host_fd), link)
        except OSError as error:
            self._close_ends()
            raise LinkError(f"{link}: {error.strerror}") from None

    def write(self, data: bytes, now_ns: int) -> bool:
        """Send, at ``now_ns`` of a steady clock; False when what waited unread had to go."""
        if unread_bytes(self._host_fd) == 0:
            self._empty_ns = now_ns
        overdue = now_ns - self._empty_ns > LONGEST_WAIT_NS
        if not overdue and self._written(data) == len(data):
            return True
        self._discard_unread()
        self._empty_ns = now_ns
        self._written(data)
        return False

    def read_input(self) -> bytes:
        """What the host sent since, at most 4096 bytes."""
        with contextlib.suppress(OSError):
            return os.read(self._device_fd, 4096)
        return b""

    def close(self) -> None:
        """Pull the plug: whoever reads sees the line hang up, and the name is gone."""
        with contextlib.suppress(FileNotFoundError):
            self._link.unlink()
        self._close_ends()

    def _discard_unread(self) -> None:
        termios.tcflush(self._device_fd, termios.TCOFLUSH)
        termios.tcflush(self._host_fd, termios.TCIFLUSH)

    def _written(self, data: bytes) -> int:
        try:
            return os.write(self._device_fd, data)
        except BlockingIOError:
            return 0

    def _close_ends(self) -> None:
        os.close(self._device_fd)
        os.close(self._host_fd)
