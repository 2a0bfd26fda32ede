"""The real viewer without a window, for pictures in docs and tests.

It needs a Vulkan driver; one that calculates on the processor will do. The viewer is started by us
and stopped with the context; it listens on 127.0.0.1 only.
"""

from __future__ import annotations

import contextlib
import io
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from PIL import Image
from rerun.experimental import ViewerClient

from recorder.errors import BadInput
from replay.rrd.program import LOCAL, free_ports, is_listening, viewer_environment, viewer_program

NEEDS_DRIVER = "no Vulkan driver for the viewer: sudo apt install mesa-vulkan-drivers"
_START_S, _LOAD_S, _PAINT_S = 30.0, 60.0, 0.4


class HeadlessViewer:
    """One recording, open in a viewer without a window. Use it as a context.

    Raises BadInput when the viewer cannot start (``NEEDS_DRIVER``) or does not load the file.
    """

    def __init__(self, path: str | Path, *, size: tuple[int, int] = (1600, 1000)) -> None:
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 (closed by stop)
        port = free_ports(1)[0]
        self._process = subprocess.Popen(
            [str(viewer_program()), "--headless", "--bind", LOCAL, "--port", str(port),
             "--window-size", f"{size[0]}x{size[1]}"],
            env=viewer_environment(), stdin=subprocess.DEVNULL, stdout=self._log,
            stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            self._wait_for(port)
            self._client = ViewerClient.connect(f"rerun+http://{LOCAL}:{port}/proxy")
            self._open(Path(path))
        except BaseException:
            self.stop()
            raise

    def __enter__(self) -> HeadlessViewer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """End the viewer."""
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()

    @property
    def steps(self) -> tuple[int, int]:
        """First and last step of the recording."""
        for timeline in self._client.get_state().recordings[0].timelines:
            if timeline.name == "step":
                return int(timeline.start), int(timeline.end)
        raise BadInput("the recording has no steps")

    @property
    def now(self) -> tuple[str, int]:
        """The timeline and the time on it that the viewer stands at."""
        recording = self._client.get_state().recordings[0]
        return str(recording.current_timeline), int(recording.current_time or 0)

    @property
    def process_id(self) -> int:
        """Of the viewer."""
        return self._process.pid

    @property
    def views(self) -> list[str]:
        """Names of the views that can be seen."""
        return [view.name for view in self._client.get_state().views if view.visible]

    @property
    def complaints(self) -> list[str]:
        """What any view reported as wrong with what it shows."""
        return [
            f"{view.name}: {report.severity} {report.summary}"
            for view in self._client.get_state().views
            for report in view.reports
        ]

    def go_to(self, step: int, timeline: str = "step") -> None:
        """Move the viewer to a step, paused."""
        self._client.set_time(timeline, sequence=step, play_state="paused")
        time.sleep(_PAINT_S)

    def screenshot(self, view: str | None = None) -> Image.Image:
        """A picture of a view, by its name, or of the whole window."""
        shown = self._client.get_state().views
        ids = {each.name: each.view_id for each in shown}
        if view is not None and view not in ids:
            raise BadInput(f"the recording has no view {view!r}; there are {', '.join(ids)}")
        png = self._client.take_screenshot(None if view is None else ids[view])
        return Image.open(io.BytesIO(png)).convert("RGB")

    def _wait_for(self, port: int) -> None:
        for _ in _until(_START_S):
            if self._process.poll() is not None:
                raise BadInput(self._why_not())
            if is_listening(port):
                return
        raise BadInput("the viewer did not start in time")

    def _open(self, path: Path) -> None:
        self._client.open([str(path.resolve())])
        for _ in _until(_LOAD_S):
            if self._process.poll() is not None:
                raise BadInput(self._why_not())
            with contextlib.suppress(RuntimeError, ConnectionError):
                state = self._client.get_state()
                if state.recordings and state.views and not state.loading:
                    time.sleep(_PAINT_S)
                    return
        raise BadInput(f"{path}: the viewer did not load it in time")

    def _why_not(self) -> str:
        self._log.seek(0)
        said = self._log.read().decode(errors="replace")
        if "No graphics adapter" in said or "adapter" in said.lower():
            return NEEDS_DRIVER
        lines = said.strip().splitlines() or ["it did not say why"]
        return f"the viewer stopped: {lines[-1]}"


def _until(seconds: float) -> Iterator[None]:
    """Once every tenth of a second, until the time is over."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        yield
        time.sleep(0.1)
