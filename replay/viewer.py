"""Open a recording to look at it: in a window, in a browser, or as a picture in a file.

Everything that is started listens on 127.0.0.1 only and sends no usage statistics.
"""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path

from recorder.errors import BadInput
from recorder.foreign import check_file
from recorder.session import looks_like_session
from replay.rrd.program import (
    LOCAL,
    free_ports,
    has_display,
    viewer_environment,
    viewer_program,
)

_MAGIC = b"RRF"  # all formats of .rrd begin so
NO_DISPLAY = "there is no display to open a window on; use --web to look at it in a browser"


def open_viewer(
    path: str | Path,
    *,
    web: bool = False,
    announce: Callable[[str], None] | None = None,
    browser: bool = True,
) -> None:
    """Show a recording, or all of those in a folder as a table with a picture of each.

    In a window of its own, which stays when this program ends; or with ``web`` in a browser, until
    Ctrl-C: ``announce`` is then called with the page's address, and ``browser`` is whether to
    open it as well. A folder is shown until its window is closed, or Ctrl-C. Raises BadInput for a
    file that is not there or no recording (a session has no map yet), for a folder without one, and
    where there is no display for a window.
    """
    path = Path(path)
    if path.is_dir():
        _show_folder(path, web, announce, browser)
        return
    if not _check_recording(path) and announce is not None:
        announce(f"{path} was not ended properly; it is shown as far as it goes")
    if web:
        _serve(path, announce, browser)
        return
    if not has_display():
        raise BadInput(NO_DISPLAY)
    port = free_ports(1)[0]
    subprocess.Popen(
        [str(viewer_program()), "--bind", LOCAL, "--port", str(port), str(path.resolve())],
        env=viewer_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=sys.platform != "win32",
    )


def screenshot(
    path: str | Path, step: int, out_png: str | Path, view: str | None = None
) -> list[str]:
    """Draw one step of a recording into a PNG, without a window.

    The whole window, or the view of that name. Returns what any view complained of. Raises BadInput
    when there is no Vulkan driver, or no such view.
    """
    from replay.rrd.headless import HeadlessViewer

    with HeadlessViewer(path) as viewer:
        viewer.go_to(step)
        viewer.screenshot(view).save(out_png)
        return viewer.complaints


@contextlib.contextmanager
def waiting_viewer(
    *, web: bool = False, announce: Callable[[str], None] | None = None, browser: bool = True
) -> Iterator[str]:
    """An empty viewer, and the address at which it takes what is logged.

    A window stays when the context ends; with ``web`` the page is served as long as the context.
    Raises BadInput where there is no display for a window.
    """
    if web:
        from replay.rrd.web import WebViewer

        with WebViewer() as viewer:
            _show_page(viewer.url, announce, browser)
            yield viewer.source
        return
    if not has_display():
        raise BadInput(NO_DISPLAY)
    from replay.rrd.viewer_process import ViewerProcess

    window = ViewerProcess(
        lambda ports: ["--port", str(ports[0])], 1, own_session=True, outlives=True
    )
    yield f"rerun+http://{LOCAL}:{window.ports[0]}/proxy"


def _check_recording(path: Path) -> bool:
    """Whether it was ended properly.

    Raises BadInput, with what to do, for what the viewer could only show as an empty page.
    """
    check_file(path)
    if looks_like_session(path):
        mapped = path.with_suffix(".rrd")
        raise BadInput(f"{path} is a session; map it first: echogrid map {path} -o {mapped}")
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise BadInput(f"{path}: not a recording; echogrid map SESSION -o NAME.rrd makes one")
    from replay.rrd.reader import is_whole

    return is_whole(path)


def _show_folder(
    folder: Path, web: bool, announce: Callable[[str], None] | None, browser: bool
) -> None:
    from replay.rrd.catalogue import Catalogue, runs_in

    runs = runs_in(folder)
    if not web and not has_display():
        raise BadInput(NO_DISPLAY)
    if announce is not None:
        for reason in runs.left_out:
            announce(f"not shown: {reason}")
    with _ended_by_sigterm(), Catalogue(runs.files) as catalogue:
        catalogue.lay_out_table(runs.files)
        with contextlib.suppress(KeyboardInterrupt):
            if web:
                _serve_page(catalogue.url, announce, browser)
            else:
                _show_window(catalogue.url)


def _serve_page(source: str, announce: Callable[[str], None] | None, browser: bool) -> None:
    from replay.rrd.web import WebViewer

    with WebViewer(source=source) as viewer:
        _show_page(viewer.url, announce, browser)
        viewer.wait()


def _show_window(source: str) -> None:
    """A window until it is closed."""
    from replay.rrd.viewer_process import ViewerProcess

    window = ViewerProcess(lambda ports: ["--port", str(ports[0]), source], 1)
    try:
        window.wait()
    finally:
        window.stop()


def _serve(path: Path, announce: Callable[[str], None] | None, browser: bool) -> None:
    from replay.rrd.web import WebViewer

    with _ended_by_sigterm(), WebViewer(path) as viewer, contextlib.suppress(KeyboardInterrupt):
        _show_page(viewer.url, announce, browser)
        viewer.wait()


@contextlib.contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """SIGTERM unwinds the program, so that the servers end with it; exit code 143, as usual."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(*_: object) -> None:
        raise SystemExit(128 + signal.SIGTERM)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _show_page(url: str, announce: Callable[[str], None] | None, browser: bool) -> None:
    if announce is not None:
        announce(url)
    if browser:
        webbrowser.open(url)
