"""The real viewer in tests: skipped where it cannot run, but never where CI=true.

``Browser`` drives a headless Chromium through its debugging pipe (no further package needed).
"""

from __future__ import annotations

import base64
import contextlib
import fcntl
import io
import json
import os
import shutil
import socketserver
import subprocess
import tempfile
import threading
import time
import urllib.parse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mapping.grid import GridGeometry
from recorder.errors import BadInput
from replay.rrd.headless import HeadlessViewer

NEEDS_CHROMIUM = "no Chromium: sudo apt install chromium"
PATIENCE_S = 300.0  # with a browser that draws on a busy processor
PRESS_AGAIN_S = 60.0  # that busy, a page takes half a minute to show what a key did
PRESS_AGAIN_LOOKS = 5  # and so many pictures must show that nothing happened


def on_ci() -> bool:
    return os.environ.get("CI", "").lower() == "true"


def not_here(reason: str) -> None:
    """Skip with what to install; fail where everything must be there."""
    if on_ci():
        pytest.fail(reason)
    pytest.skip(reason)


def headless(path: Path | str, **options: Any) -> HeadlessViewer:
    """The viewer with a recording open, or a skip."""
    try:
        return HeadlessViewer(path, **options)
    except BadInput as error:
        if "Vulkan" not in str(error):
            raise
        not_here(str(error))
        raise


@dataclass(frozen=True)
class Scale:
    """From pixels of a view to metres of the map."""

    left: float
    bottom: float
    px_per_m: float
    geometry: GridGeometry

    @classmethod
    def of(cls, empty: np.ndarray, geometry: GridGeometry) -> Scale:
        """By where the empty grid of the first step lies, as a mask of its pixels."""
        rows, cols = np.nonzero(empty)
        width = cols.max() + 1 - cols.min()
        return cls(cols.min(), rows.max() + 1, width / geometry.size_m[0], geometry)

    def metres(self, mask: np.ndarray) -> np.ndarray:
        """Centres of a mask's pixels, (N, 2)."""
        rows, cols = np.nonzero(mask)
        offset = np.column_stack([cols + 0.5 - self.left, self.bottom - rows - 0.5])
        return offset / self.px_per_m + self.geometry.origin_m

    def pixels(self, points_m: np.ndarray) -> np.ndarray:
        """Points (N, 2) as row and column, whole numbers."""
        offset = (points_m - self.geometry.origin_m) * self.px_per_m
        return np.column_stack([self.bottom - offset[:, 1], self.left + offset[:, 0]]).astype(int)


def near(image: Image.Image, colour: tuple[int, ...], within: int = 12) -> np.ndarray:
    """Which pixels have about that colour."""
    gap = np.abs(np.asarray(image).astype(int) - np.array(colour[:3])).max(axis=-1)
    close: np.ndarray = gap <= within
    return close


class Outside(socketserver.ThreadingTCPServer):
    """Stands where the way to other machines begins: notes who is asked for, lets nothing through.

    ``hosts`` are the machines that a browser would have talked to.
    """

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Refusal)
        self.hosts: set[str] = set()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        """As a browser takes a proxy."""
        return f"http://127.0.0.1:{self.server_address[1]}"


class _Refusal(socketserver.StreamRequestHandler):
    server: Outside

    def handle(self) -> None:
        """``CONNECT host:port`` or ``GET http://host/...``: write the host down and hang up."""
        _, _, target = self.rfile.readline(65536).decode("latin-1").partition(" ")
        url = target.split(" ")[0]
        host = urllib.parse.urlsplit(url if "://" in url else f"//{url}").hostname
        self.server.hosts.add(host or url)


class Browser:
    """A headless Chromium showing one page; it can reach no machine but this one."""

    def __init__(self, url: str, size: tuple[int, int] = (1200, 800)) -> None:
        program = shutil.which("chromium") or shutil.which("chromium-browser")
        if program is None:
            not_here(NEEDS_CHROMIUM)
        low_in, self._out = os.pipe()
        self._in, low_out = os.pipe()
        to_it, from_it = (fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (low_in, low_out))
        os.close(low_in)
        os.close(low_out)
        self._profile = tempfile.TemporaryDirectory()
        self._outside = Outside()

        def as_files_3_and_4() -> None:
            os.dup2(to_it, 3)
            os.dup2(from_it, 4)

        self._process = subprocess.Popen(
            [str(program), "--headless=new", "--no-sandbox",
             "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
             f"--proxy-server={self._outside.address}", "--remote-debugging-pipe",
             f"--user-data-dir={self._profile.name}",
             f"--window-size={size[0]},{size[1]}", url],
            preexec_fn=as_files_3_and_4, pass_fds=(3, 4),  # noqa: PLW1509 (no threads here)
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(to_it)
        os.close(from_it)
        self._number = 0
        self._waiting = b""
        self._session = self._attach()

    def screenshot(self) -> Image.Image:
        png = self._call("Page.captureScreenshot", format="png")["data"]
        return Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")

    def press(self, key: str, *, ctrl_shift: bool = False) -> None:
        """A key, alone or with Ctrl and Shift held."""
        code = {"ArrowLeft": 37, "ArrowRight": 39}[key]
        for kind in ("rawKeyDown", "keyUp"):
            self._call(
                "Input.dispatchKeyEvent", type=kind, key=key, code=key,
                windowsVirtualKeyCode=code, modifiers=(2 | 8) if ctrl_shift else 0,
            )  # fmt: skip

    def requests_elsewhere(self) -> list[str]:
        """What the page sent to any machine but this one.

        A page's own list also names what its policy forbade, which was never sent. So only that
        counts which came to where the way outside begins. (Chromium itself asks there, too.)
        """
        script = "JSON.stringify(performance.getEntriesByType('resource').map(e => e.name))"
        names = json.loads(self._call("Runtime.evaluate", expression=script)["result"]["value"])
        sent = self.hosts_elsewhere()
        return [name for name in names if urllib.parse.urlsplit(name).hostname in sent]

    def hosts_elsewhere(self) -> set[str]:
        """The machines that the page, or Chromium for itself, would have talked to by now."""
        return set(self._outside.hosts)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._call("Browser.close", session=False)
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._out)
        os.close(self._in)
        self._outside.shutdown()
        self._outside.server_close()
        with contextlib.suppress(OSError):
            self._profile.cleanup()

    def _attach(self) -> str:
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            targets = self._call("Target.getTargets", session=False)["targetInfos"]
            pages = [target for target in targets if target["type"] == "page"]
            if pages:
                target = pages[0]["targetId"]
                answer = self._call(
                    "Target.attachToTarget", session=False, targetId=target, flatten=True
                )
                return str(answer["sessionId"])
            time.sleep(0.1)
        raise RuntimeError("Chromium opened no page")

    def _call(self, method: str, *, session: bool = True, **params: Any) -> dict[str, Any]:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": params}
        if session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._waiting:
                got = os.read(self._in, 1 << 16)
                if not got:
                    raise OSError("Chromium went away")
                self._waiting += got
            raw, self._waiting = self._waiting.split(b"\0", 1)
            answer = json.loads(raw)
            if answer.get("id") == self._number:
                return dict(answer.get("result", {}))


class Patiently:
    """A browser looked at until what one waits for is there."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser

    def until(self, what: Callable[[Image.Image], bool], name: str) -> Image.Image:
        end = time.monotonic() + PATIENCE_S
        while True:
            picture = self.browser.screenshot()
            if what(picture):
                return picture
            assert time.monotonic() < end, f"the browser never showed {name}"
            time.sleep(0.5)

    def press_until(
        self, key: str, before: Callable[[Image.Image], bool],
        after: Callable[[Image.Image], bool], name: str,
    ) -> Image.Image:  # fmt: skip
        """A key; once more when the page long stays as it was, as one that got no key does."""
        looks, again = 0, 0.0

        def pressed(picture: Image.Image) -> bool:
            nonlocal looks, again
            if after(picture):
                return True
            looks += 1
            if before(picture) and looks >= PRESS_AGAIN_LOOKS and time.monotonic() > again:
                self.browser.press(key)
                looks, again = 0, time.monotonic() + PRESS_AGAIN_S
            return False

        self.browser.press(key)
        again = time.monotonic() + PRESS_AGAIN_S
        return self.until(pressed, name)
