"""The staff's page of one building: chairs, queues, closures, waits and their reasons; staff set priorities there with their key.

It needs no web framework. The page itself is open to this computer; its data and its form need the token, which is in no
address: the page asks for it once. Nobody else's page in the same browser can use it (`guard`).
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

from waychair.errors import ConfigError, TaskError
from waychair.types import Json
from waychair.ui.guard import is_host, is_token

LONGEST_FORM = 2_000
"""bytes of a form that is read."""

_FILES = {
    "/": ("staff.html", "text/html; charset=utf-8"),
    "/staff.js": ("js/staff.js", "text/javascript; charset=utf-8"),
    "/staff.css": ("staff.css", "text/css; charset=utf-8"),
    "/theme.css": ("theme.css", "text/css; charset=utf-8"),
}
_STATIC = Path(__file__).parent / "static"
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
_PATIENCE_S = 5.0  # for one request

Give = Callable[[int, str, str, float], str]
"""Gives a chair a priority: chair, priority, key, minutes; returns a sentence, or raises TaskError."""


class StaffPage:
    """The latest view (`runtime.fleet.desk.staff_desk.staff_view`), which any thread may replace, and the way to give priorities."""

    def __init__(self, token: str, give: Give) -> None:
        self.token, self.give = token, give
        self.view: Json = {}


@contextmanager
def staff_page(page: StaffPage, port: int = 0) -> Iterator[str]:
    """Serve the page on this computer only during the block; yield its address. Port 0: any free one.

    Raises:
        ConfigError: the port is taken, or there is no token.
    """
    if not page.token:
        raise ConfigError("the staff's page needs a token: give one")
    try:
        server = ThreadingHTTPServer(("127.0.0.1", port), _handler(page))
    except (OSError, OverflowError) as error:
        raise ConfigError(f"the staff's page cannot use port {port} ({error}): give another one") from None
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, name="staff page", daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()


def _handler(page: StaffPage) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """Answers GET of the page, its files and the view, and POST of a priority."""

        timeout = _PATIENCE_S

        def do_GET(self) -> None:
            """Answer with a file, or with the view to a page that has the token."""
            if self.path in _FILES and is_host(self.headers.get("Host", ""), ()):
                name, kind = _FILES[self.path]
                self._answer(200, (_STATIC / name).read_bytes(), kind)
            elif self.path != "/view":
                self._say(404, "There is no such page.")
            elif self._is_allowed():
                self._answer(200, json.dumps(page.view).encode(), "application/json")

        def do_POST(self) -> None:
            """Give a chair a priority."""
            length = self.headers.get("Content-Length", "")
            if self.path != "/priority":
                self._say(404, "There is no such page.")
            elif not length.isdecimal() or len(length) > 9 or int(length) > LONGEST_FORM:
                self._say(413, "The form is too long.")
            elif self._is_allowed():
                try:
                    values = json.loads(self.rfile.read(int(length)))
                    chair, name, key = int(values["chair"]), str(values["priority"]), str(values["key"])
                    minutes = float(values["minutes"])
                except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
                    self._say(400, "The form is damaged: load the page again.")
                    return
                try:
                    self._say(200, page.give(chair, name, key, minutes))
                except TaskError as error:
                    told = str(error)
                    self._say(409, told[0].upper() + told[1:] + ".")

        def _is_allowed(self) -> bool:
            """Whether a request comes from this server's own page with the token; answers it otherwise."""
            host = self.headers.get("Host", "")
            origin = self.headers.get("Origin")
            foreign = self.headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none")
            if not is_host(host, ()) or foreign or (origin is not None and urlsplit(origin).netloc != host):
                self._say(403, "Pages of other sites may not talk to the chairs.")
                return False
            scheme, _, told = self.headers.get("Authorization", "").partition(" ")
            if scheme.lower() != "bearer" or not is_token(told, page.token):
                self._say(401, "The token is missing or wrong: enter the one that waychair printed when it started.")
                return False
            return True

        def _say(self, status: int, sentence: str) -> None:
            self._answer(status, sentence.encode(), "text/plain; charset=utf-8")

        def _answer(self, status: int, body: bytes, kind: str) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", _POLICY)
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("Referrer-Policy", "no-referrer")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    return Handler
