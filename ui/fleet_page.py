"""A page of this computer that shows all chairs of a fleet's demo from above; it only shows, and commands nothing.

It needs no web framework: one page, its files, and the latest view as JSON.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from waychair.errors import ConfigError
from waychair.types import Json
from waychair.ui.guard import is_host

_FILES = {
    "/": ("fleet.html", "text/html; charset=utf-8"),
    "/fleet.js": ("js/fleet.js", "text/javascript; charset=utf-8"),
    "/theme.css": ("theme.css", "text/css; charset=utf-8"),
    "/icon.svg": ("icon.svg", "image/svg+xml"),
}
_STATIC = Path(__file__).parent / "static"
_POLICY = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; img-src 'self'"


class FleetPage:
    """The latest view of a fleet, as plain JSON values; any thread may replace it."""

    def __init__(self) -> None:
        self.plan: Json = {}
        self.view: Json = {}


@contextmanager
def fleet_page(page: FleetPage, port: int = 0) -> Iterator[str]:
    """Serve the page on this computer only during the block; yield its address. Port 0: any free one.

    Raises:
        ConfigError: the port is taken.
    """
    try:
        server = ThreadingHTTPServer(("127.0.0.1", port), _handler(page))
    except (OSError, OverflowError) as error:
        raise ConfigError(f"the fleet's page cannot use port {port} ({error}): give another --page-port") from None
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, name="fleet page", daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()


def _handler(page: FleetPage) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """Answers GET of the page, its files, the plan and the view."""

        def do_GET(self) -> None:
            """Answer one request; another host's name is refused (DNS rebinding)."""
            if not is_host(self.headers.get("Host", ""), ()):
                self.send_error(403)
            elif self.path in _FILES:
                name, kind = _FILES[self.path]
                self._answer((_STATIC / name).read_bytes(), kind)
            elif self.path in ("/plan", "/view"):
                value = page.plan if self.path == "/plan" else page.view
                self._answer(json.dumps(value).encode(), "application/json")
            else:
                self.send_error(404)

        def _answer(self, body: bytes, kind: str) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", _POLICY)
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    return Handler
