"""Access control of the page's server: pages of this computer are let in, pages from the network need the token.

A page of another site in the same browser can reach this server, too. It is refused by the `Origin` and
`Sec-Fetch-Site` headers, which it cannot forge. A foreign name that points at this computer (DNS rebinding) is refused
by the `Host` header. (Fetch and Fetch Metadata standards; WebSockets have no same-origin rule.)
"""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Awaitable, Callable, MutableMapping, Sequence
from typing import Any
from urllib.parse import urlsplit

AsgiMessage = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[AsgiMessage]]
Send = Callable[[AsgiMessage], Awaitable[None]]
AsgiApp = Callable[[AsgiMessage, Receive, Send], Awaitable[None]]

API = "/api/"
LIVE = "/api/live"
"""Path of the pages' socket. Its token comes in the first message: browsers cannot send one with the request."""

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = (
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


def is_token(told: str, token: str) -> bool:
    """Whether a page has sent the token, compared in constant time; always true without a token."""
    return not token or hmac.compare_digest(told.encode(), token.encode())


def is_host(host: str, names: Sequence[str]) -> bool:
    """Whether a `Host` header names this server: an address, localhost or one of `names`, with or without a port.

    A name NAME without a dot stands for NAME.local, too (multicast DNS). All other names with one of `names` in them are
    another computer's.
    """
    try:
        name = (urlsplit(f"//{host}").hostname or "").removesuffix(".")  # "chair.local." is the same name in full
    except ValueError:
        return False
    known = {"localhost", *(each.lower().removesuffix(".") for each in names)}
    bare = name.removesuffix(".local")
    if name and (name in known or ("." not in bare and bare in known - {"localhost"})):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


class RequestGuard:
    """Middleware that refuses foreign requests and adds the security headers to every answer.

    `names`: host names of this server besides localhost and its addresses. `local`: only loopback addresses are hosts.
    """

    def __init__(self, app: AsgiApp, token: str, names: Sequence[str] = (), local: bool = True) -> None:
        self._app = app
        self._token = token
        self._names = names
        self._local = local

    async def __call__(self, scope: AsgiMessage, receive: Receive, send: Send) -> None:
        """Handle one request or one socket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return

        async def send_guarded(message: AsgiMessage) -> None:
            if message["type"] == "http.response.start":
                headers = [*message.get("headers", ()), *_HEADERS]
                if all(name != b"cache-control" for name, _ in headers):
                    headers.append((b"cache-control", b"no-cache"))  # otherwise a browser might show an old page
                message["headers"] = headers
            await send(message)

        told = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        status, reason = self._refusal(scope, told)
        if not status:
            await self._app(scope, receive, send_guarded)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 4000 + status, "reason": reason})
        else:
            kind = [(b"content-type", b"text/plain; charset=utf-8")]
            await send_guarded({"type": "http.response.start", "status": status, "headers": kind})
            await send({"type": "http.response.body", "body": reason.encode()})

    def _refusal(self, scope: AsgiMessage, headers: dict[str, str]) -> tuple[int, str]:
        """Return the status and the sentence of a refusal; status 0 for none."""
        host = headers.get("host", "")
        if not is_host(host, self._names) or (self._local and not _is_loopback(host)):
            other = "" if self._local else ", or start waychair with --page-name and this name"
            return 403, f"This name is not known here: open the page by an address that waychair printed{other}."
        origin = headers.get("origin")
        if origin is not None and _netloc(origin) != host.lower():
            return 403, "Pages of other sites may not talk to the chair."
        if headers.get("sec-fetch-site", "none") not in ("same-origin", "none") and scope["path"].startswith(API):
            return 403, "Pages of other sites may not talk to the chair."
        if scope["type"] == "http" and scope["path"].startswith(API):
            scheme, _, told = headers.get("authorization", "").partition(" ")
            if not is_token(told if scheme.lower() == "bearer" else "", self._token):
                return 401, "The token is missing or wrong: enter the one that waychair printed when it started."
        return 0, ""


def _netloc(origin: str) -> str:
    """Return name and port of an `Origin` header; empty for an invalid one."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""


def _is_loopback(host: str) -> bool:
    name = urlsplit(f"//{host}").hostname or ""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False
