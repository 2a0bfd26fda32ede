"""The viewer as a program: where it is, how it is kept quiet and local.

It comes with the rerun package as one executable. It is started directly, not through its Python
wrapper, so that stopping the process stops the viewer and not only the wrapper.
"""

from __future__ import annotations

import importlib.util
import os
import socket
import sys
from pathlib import Path

from recorder.errors import BadInput

LOCAL = "127.0.0.1"


def viewer_program() -> Path:
    """The viewer's executable. Raises BadInput when the rerun package is not installed whole."""
    spec = importlib.util.find_spec("rerun_cli")
    for place in (spec.submodule_search_locations or []) if spec is not None else []:
        folder = Path(place)
        for name in ("rerun.exe", "Rerun.app/Contents/MacOS/Rerun", "rerun"):
            if (folder / name).is_file():
                return folder / name
    raise BadInput("the Rerun viewer is not installed (pip install rerun-sdk)")


def viewer_environment() -> dict[str, str]:
    """Our own environment, with the viewer's usage statistics switched off.

    Its only switches are a setting of the user (``rerun analytics disable``) and the variable by
    which it recognises test machines; a variable touches nothing but what we start.
    """
    return {**os.environ, "CI": "true", "RERUN_APP_ONLY": "true"}


def has_display() -> bool:
    """Whether a window can be opened here."""
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def free_ports(count: int) -> list[int]:
    """Ports of this machine that nobody listens on just now, all different."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for each in sockets:
            each.bind((LOCAL, 0))
        return [int(each.getsockname()[1]) for each in sockets]
    finally:
        for each in sockets:
            each.close()


def is_listening(port: int) -> bool:
    """Whether someone answers on a port of this machine."""
    with socket.socket() as probe:
        probe.settimeout(0.5)
        return probe.connect_ex((LOCAL, port)) == 0
