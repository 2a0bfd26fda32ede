"""Imported first of all: Ctrl-C ends the program in one line while the rest is being imported.

Only where the program is ``echogrid``; who merely imports it keeps their own ways. It needs nothing
that Python has not loaded already, so that no moment is left in which a traceback would show.
Nor is what is being imported looked through for garbage: it stays.
"""

from __future__ import annotations

import gc
import os
import sys

_signal = __import__("_signal")  # what `signal` is made of, and there at once
SELDOM = 200_000  # objects, which is more than a start makes, between two looks for garbage
_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")  # not every system has them all
ENDING = tuple(int(getattr(_signal, name)) for name in _ENDING if hasattr(_signal, name))


def end_now(number: int, _frame: object = None) -> None:
    """End at once, with one line and without a trace of unfinished files."""
    remove = getattr(sys.modules.get("recorder.outputs"), "remove_unfinished", None)
    if remove is not None:
        remove()
    os.write(2, b"echogrid: stopped\n")
    os._exit(128 + number)


def not_ignored() -> list[int]:
    """The signals that ask for an end; one that is ignored stays so (nohup)."""
    return [number for number in ENDING if _signal.getsignal(number) != _signal.SIG_IGN]


if os.path.splitext(os.path.basename(sys.argv[0] if sys.argv else ""))[0] == "echogrid":
    gc.set_threshold(SELDOM, *gc.get_threshold()[1:])
    for _number in not_ignored():
        _signal.signal(_number, end_now)
