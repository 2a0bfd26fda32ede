"""The viewer in a browser of this machine: a server that keeps everything here.

The viewer's own server hands out the page and the recording. Ours stands before the page and adds
one header, by which the browser refuses to load anything but from 127.0.0.1: no usage statistics.
It also takes out the page's mention of fonts from elsewhere: a browser opens connections to what is
named as "preconnect", whatever the header says. Both end with the context.
"""

from __future__ import annotations

import contextlib
import http.client
import http.server
import re
import threading
import urllib.parse
from collections.abc import Sequence
from http import HTTPStatus
from pathlib import Path

from replay.rrd.catalogue import Catalogue, can_be_served
from replay.rrd.program import LOCAL
from replay.rrd.viewer_process import ViewerProcess

POLICY = (
    "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; "
    f"connect-src 'self' data: blob: http://{LOCAL}:*; worker-src 'self' blob:"
)
_ELSEWHERE = re.compile(  # in the page: links, and style sheets that a style sheet asks for
    rb"""<link\b[^>]*\bhref\s*=\s*["']?(?:https?:)?//[^>]*>|@import\b[^;]*//[^;]*;""", re.IGNORECASE
)


_OWN_NAMES = (LOCAL, "localhost", "::1")


def _host_of(header: str) -> str | None:
    try:
        return urllib.parse.urlsplit(f"//{header}").hostname
    except ValueError:
        return None


class WebViewer(contextlib.AbstractContextManager["WebViewer"]):
    """Serve one recording to a browser; ``url`` is the page. Use it as a context.

    Of a recording that was ended properly the page fetches what it shows, from a catalogue; another
    it takes in whole. Instead of a file it may show what is at ``source``, a catalogue's address;
    without either it waits for what is logged to ``source``.

    Raises BadInput when the server does not start.
    """

    def __init__(self, path: str | Path | None = None, *, source: str = "") -> None:
        with contextlib.ExitStack() as ends:
            if path is not None and can_be_served(Path(path)):
                catalogue = ends.enter_context(Catalogue([Path(path)]))
                catalogue.lay_out_as(Path(path))
                source = catalogue.first_url
            files = [] if path is None or source else [str(path)]
            self._viewer = _page_server(source, files)
            ends.callback(self._viewer.stop)
            page_port = self._viewer.ports[0]
            self.source = source or f"rerun+http://{LOCAL}:{self._viewer.ports[1]}/proxy"
            self._door = _Door((LOCAL, 0), page_port)
            threading.Thread(target=self._door.serve_forever, daemon=True).start()
            ends.callback(self._door.server_close)
            ends.callback(self._door.shutdown)
            quoted = urllib.parse.quote(self.source, safe="")
            self.url = f"http://{LOCAL}:{self._door.server_port}/?url={quoted}"
            self._ends = ends.pop_all()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def wait(self) -> None:
        """Serve until the viewer's server ends, or Ctrl-C."""
        self._viewer.wait()

    def stop(self) -> None:
        """End all servers."""
        self._ends.close()


def _page_server(source: str, files: Sequence[str]) -> ViewerProcess:
    """The viewer's server of the page; unless there is a ``source``, also of what is shown."""
    if source:
        return ViewerProcess(
            lambda ports: ["--serve-web", "--web-viewer-port", str(ports[0]), source], 1
        )
    return ViewerProcess(
        lambda ports: [
            "--serve-web", "--web-viewer-port", str(ports[0]), "--port", str(ports[1]),
            "--cors-allow-origin", f"http://{LOCAL}:*", *files,
        ], 2, own_session=not files,  # Ctrl-C ends what logs to it, not the page
    )  # fmt: skip


class _Door(http.server.ThreadingHTTPServer):
    """Hands requests on to the viewer's page server."""

    def __init__(self, address: tuple[str, int], page_port: int) -> None:
        super().__init__(address, _Handler)
        self.page_port = page_port


class _Handler(http.server.BaseHTTPRequestHandler):
    server: _Door

    def do_GET(self) -> None:
        """Fetch the same path from the page server, and add the policy.

        Asked for by another name than this machine's own, it was a page elsewhere that asked: a
        browser takes it for this one's where a name server sends it here.
        """
        if _host_of(self.headers.get("Host", "")) not in _OWN_NAMES:
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
            return
        behind = http.client.HTTPConnection(LOCAL, self.server.page_port, timeout=30.0)
        try:
            behind.request("GET", self.path)
            answer = behind.getresponse()
            body = answer.read()
        except (OSError, http.client.HTTPException):
            self.send_error(HTTPStatus.BAD_GATEWAY)
            return
        finally:
            behind.close()
        if (answer.getheader("Content-Type") or "").startswith("text/html"):
            body = _ELSEWHERE.sub(b"", body)
        self.send_response(answer.status)
        for name in ("Content-Type", "rerun-final-length"):
            if value := answer.getheader(name):
                self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Content-Security-Policy", POLICY)
        self.end_headers()
        with contextlib.suppress(ConnectionError):  # the browser went away
            self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing: every picture and font would be a line."""
