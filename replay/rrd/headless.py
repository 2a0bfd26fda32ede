"""The real viewer without a window, for pictures in docs and tests.

It needs a Vulkan driver; one that calculates on the processor will do. The viewer is started by us
and stopped with the context; it listens on 127.0.0.1 only.
"""

from __future__ import annotations

import contextlib
import io
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from PIL import Image
from rerun.experimental import ViewerClient

from recorder.errors import BadInput
from replay.rrd.program import LOCAL
from replay.rrd.viewer_process import NEEDS_DRIVER, ViewerProcess, until

__all__ = ["NEEDS_DRIVER", "HeadlessViewer"]

_LOAD_S, _PAINT_S, _ANSWER_S = 120.0, 0.4, 120.0
_WELL_KNOWN = ("Software rasterizer", "load examples")
T = TypeVar("T")


class HeadlessViewer(contextlib.AbstractContextManager["HeadlessViewer"]):
    """One recording, or a catalogue's address, open in a viewer without a window; a context.

    Raises BadInput when the viewer cannot start (``NEEDS_DRIVER``) or does not load the file.
    """

    def __init__(self, path: str | Path, *, size: tuple[int, int] = (1600, 1000)) -> None:
        self._viewer = ViewerProcess(
            lambda ports: ["--headless", "--port", str(ports[0]),
                           "--window-size", f"{size[0]}x{size[1]}"], 1,
        )  # fmt: skip
        try:
            url = f"rerun+http://{LOCAL}:{self._viewer.ports[0]}/proxy"
            self._client = ViewerClient.connect(url)
            self._open(str(path) if "://" in str(path) else str(Path(path).resolve()))
        except BaseException:
            self.stop()
            raise

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End the viewer."""
        self._viewer.stop()

    @property
    def steps(self) -> tuple[int, int]:
        """First and last step of the recording."""
        for timeline in self._ask(self._client.get_state).recordings[0].timelines:
            if timeline.name == "step":
                return int(timeline.start), int(timeline.end)
        raise BadInput("the recording has no steps")

    @property
    def now(self) -> tuple[str, int]:
        """The timeline and the time on it that the viewer stands at."""
        recording = self._ask(self._client.get_state).recordings[0]
        return str(recording.current_timeline), int(recording.current_time or 0)

    @property
    def process_id(self) -> int:
        """Of the viewer."""
        return self._viewer.process_id

    @property
    def views(self) -> list[str]:
        """Names of the views that can be seen."""
        return [view.name for view in self._ask(self._client.get_state).views if view.visible]

    @property
    def complaints(self) -> list[str]:
        """What any view reported as wrong with what it shows, and what the viewer warned of.

        Not that it draws slowly or has no network: that is meant to be so.
        """
        reports = [
            f"{view.name}: {report.severity} {report.summary}"
            for view in self._ask(self._client.get_state).views
            for report in view.reports
        ]
        warnings = [
            f"{entry.level} {entry.message}"
            for entry in self._ask(self._client.get_logs)
            if entry.level != "INFO" and not any(each in entry.message for each in _WELL_KNOWN)
        ]
        return reports + warnings

    def go_to(self, step: int, timeline: str = "step", *, paint_s: float = _PAINT_S) -> None:
        """Move the viewer to a step, paused, and give it so long to paint."""
        self._ask(self._client.set_time, timeline, sequence=step, play_state="paused")
        time.sleep(paint_s)

    def screenshot(self, view: str | None = None) -> Image.Image:
        """A picture of a view, by its name, or of the whole window."""
        shown = self._ask(self._client.get_state).views
        ids = {each.name: each.view_id for each in shown}
        if view is not None and view not in ids:
            raise BadInput(f"the recording has no view {view!r}; there are {', '.join(ids)}")
        png = self._ask(self._client.take_screenshot, None if view is None else ids[view])
        return Image.open(io.BytesIO(png)).convert("RGB")

    def bring_to_front(self, name: str) -> None:
        """Open the tab in which a view of that name, or a group of views, lies."""
        layout = self._layout()
        names = ("ViewBlueprint", "ContainerBlueprint")
        found = [
            path.lstrip("/") for path, parts in layout.items()
            if any(parts.get(each, {}).get("display_name") == name for each in names)
        ]  # fmt: skip
        if not found:
            raise BadInput(f"the recording has no view {name!r}")
        inner: str | None = found[0]
        while inner is not None:
            inner = _open_tab(layout, inner)
        self._ask(self._client.set_blueprint, layout, of="recording")
        time.sleep(_PAINT_S)

    def switch(self, view: str, *entities: str, on: bool) -> None:
        """Show or hide entities in the view of that name."""
        layout = self._layout()
        for path, parts in list(layout.items()):
            if parts.get("ViewBlueprint", {}).get("display_name") == view:
                for entity in entities:
                    place = f"{path}/ViewContents/overrides{entity}/visualizers"
                    layout.setdefault(place, {})["EntityBehavior"] = {"visible": on}
        self._ask(self._client.set_blueprint, layout, of="recording")
        time.sleep(_PAINT_S)

    def _ask(self, what: Callable[..., T], *arguments: Any, **options: Any) -> T:
        """Ask the viewer, again where it is too busy to answer in time."""
        for _ in until(_ANSWER_S):
            with contextlib.suppress(TimeoutError):
                return what(*arguments, **options)
            self._viewer.check()
        raise BadInput("the viewer does not answer")

    def _layout(self) -> dict[str, Any]:
        return dict(self._ask(self._client.get_blueprint, of="recording").blueprint)

    def _open(self, what: str) -> None:
        """A file; or an address, of which only what it shows can tell whether it is there."""
        self._client.open([what])
        for _ in until(_LOAD_S):
            self._viewer.check()
            with contextlib.suppress(RuntimeError, ConnectionError):
                state = self._ask(self._client.get_state)
                if "://" in what or (state.recordings and state.views and not state.loading):
                    time.sleep(_PAINT_S)
                    return
        raise BadInput(f"{what}: the viewer did not load it in time")


def _open_tab(layout: dict[str, Any], inner: str) -> str | None:
    """Open the tab ``inner`` of the container that holds it; that container, if there is one."""
    for path, parts in layout.items():
        container = parts.get("ContainerBlueprint", {})
        if inner in container.get("contents", []):
            if container["container_kind"] == "Tabs":
                container["active_tab"] = inner
            return path.lstrip("/")
    return None
