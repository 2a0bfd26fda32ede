"""The compiled loops by name, for those who call them: loaded if an earlier run kept them.

Only where none did is numba imported, to compile (``first_run`` says so then). What a loop gives is
the same, to the bit, either way.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from threading import Lock
from typing import Any

import numpy as np

from mapping.kernels.first_run import compiling

_LOCK = Lock()


class Loop:
    """A loop of a module of kernels; called as the loop itself is."""

    def __init__(self, module: str, name: str) -> None:
        self.module, self.name = module, name
        self._known: dict[tuple[Any, ...], Callable[..., Any]] = {}

    def __call__(self, *arguments: Any) -> Any:
        """What the loop gives."""
        kinds = tuple(map(kind_of, arguments))
        function = self._known.get(kinds)
        if function is None:
            with _LOCK:  # threads that share a job come here together
                function = self._known.get(kinds) or self._found(kinds, arguments)
                self._known[kinds] = function
        return function(*arguments)

    def _found(self, kinds: tuple[Any, ...], arguments: tuple[Any, ...]) -> Callable[..., Any]:
        from mapping.kernels import stored

        if os.environ.get("ECHOGRID_PLAIN_LOOPS", "") not in ("", "0"):
            return _compiled(self.module, self.name, arguments)[0]
        file = stored.file_of(self.module, self.name, repr(kinds))
        function = stored.load(file)
        if function is None:
            function, types = _compiled(self.module, self.name, arguments)
            if types is not None:
                stored.save(file, function, types)
        return function


def _compiled(
    module: str, name: str, arguments: tuple[Any, ...]
) -> tuple[Callable[..., Any], tuple[Any, ...] | None]:
    """The loop for such arguments, by numba, and their types; None where numba is switched off."""
    loop: Any = getattr(import_module(module), name)
    if not hasattr(loop, "overloads"):
        return loop, None
    types = tuple(map(loop.typeof_pyval, arguments))
    with _named_if_compiled(name):
        loop.compile(types)
    return loop, types


def kind_of(argument: Any) -> Any:
    """All of an argument that makes it another type for numba."""
    if isinstance(argument, np.ndarray):
        flags = argument.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return argument.dtype.str, argument.ndim, layout, flags.writeable, flags.aligned
    if isinstance(argument, tuple):
        return type(argument).__name__, *map(kind_of, argument)
    return type(argument).__name__


@contextmanager
def _named_if_compiled(name: str) -> Iterator[None]:
    """Report the loop's name when numba, which may have kept it itself, begins to compile."""
    from numba.core.event import Event, Listener, install_listener

    class Once(Listener):  # type: ignore[misc]
        waiting = True

        def on_start(self, event: Event) -> None:
            if self.waiting:
                self.waiting = False  # the loops that it calls go by with it
                compiling(name)

        def on_end(self, event: Event) -> None:
            """Nobody waits for that."""

    with install_listener("numba:compile", Once()):
        yield


add_fading = Loop("mapping.kernels.batch.fading", "add_fading")
add_regions = Loop("mapping.kernels.batch.regions", "add_regions")
add_bands = Loop("mapping.kernels.batch.counts", "add_bands")
add_axes = Loop("mapping.kernels.batch.axis", "add_axes")
add_cellwise = Loop("mapping.kernels.batch.cellwise", "add_cellwise")
add_rays = Loop("mapping.kernels.batch.rays", "add_rays")
add_sums = Loop("mapping.kernels.batch.sums", "add_sums")
add_scans = Loop("mapping.kernels.batch.lidar", "add_scans")
add_log_odds = Loop("mapping.kernels.merging", "add_log_odds")
wedge = Loop("mapping.kernels.footprints", "wedge")
fan = Loop("mapping.kernels.footprints", "fan")
turns_of = Loop("mapping.kernels.footprints", "turns_of")
nearest_in_cone = Loop("mapping.kernels.casting", "nearest_in_cone")
nearest_on_rays = Loop("mapping.kernels.casting", "nearest_on_rays")
take = Loop("mapping.kernels.recording", "take")
strength_classes = Loop("mapping.kernels.recording", "strength_classes")
changes_by_strength = Loop("mapping.kernels.recording", "changes_by_strength")
evidence_by_strength = Loop("mapping.kernels.recording", "evidence_by_strength")
evidence_of = Loop("mapping.kernels.recording", "evidence_of")
changes_of = Loop("mapping.kernels.recording", "changes_of")
packed_rows = Loop("mapping.kernels.recording", "packed_rows")
shade = Loop("mapping.kernels.recording", "shade")
closed_borders = Loop("mapping.line_kernels.tracing", "closed_borders")
chapter_borders = Loop("mapping.line_kernels.tracing", "chapter_borders")
distances = Loop("mapping.line_kernels.spreading", "distances")
spread = Loop("mapping.line_kernels.spreading", "spread")
thin = Loop("mapping.line_kernels.thinning", "thin")
lines_of_chains = Loop("mapping.line_kernels.lines", "lines_of_chains")
break_at_gaps = Loop("mapping.line_kernels.chains", "break_at_gaps")
walls_of_lines = Loop("mapping.line_kernels.walls", "walls_of_lines")
scan_chains = Loop("mapping.line_kernels.chains", "scan_chains")
