"""A batch on several threads: each owns every so-many-th row of the map. Does not load numba."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any


def in_parts(kernel: Callable[..., None], *arguments: Any, threads: int = 1) -> None:
    """Run a kernel that takes ``part`` and ``parts`` last; the same bytes on any number of threads.

    The kernels let go of Python's lock, so the threads run side by side.
    """
    if threads <= 1:
        kernel(*arguments, 0, 1)
        return
    with ThreadPoolExecutor(threads) as pool:
        parts = [pool.submit(kernel, *arguments, part, threads) for part in range(threads)]
        for part in parts:
            part.result()
