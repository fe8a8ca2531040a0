"""Guard of the server: it answers only pages that it served itself, on this machine, at an address with its token.

A server on a loopback address can still be reached by any page in a browser on the machine: through a name that its
owner points to 127.0.0.1 (DNS rebinding), which `Host` tells, or by a socket from a foreign page, which `Origin` tells.
"""

import secrets
from collections.abc import Iterable
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocketClose

LOOPBACK = ("127.0.0.1", "localhost", "::1")
POLICY_VIOLATION = 1008
"""Code with which a WebSocket is closed that breaks a rule of the server."""
HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self';"
        " base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
"""Headers of every answer: the page loads nothing from elsewhere, nobody frames it, and no address leaks."""


def new_token() -> str:
    """Return a random token for the address of a server."""
    return secrets.token_urlsafe(24)


class Guard:
    """Refuses requests and sockets before the app sees them."""

    def __init__(self, app: ASGIApp, token: str, hosts: Iterable[str] = LOOPBACK) -> None:
        """`hosts`: names under which the server may be asked."""
        self._app, self._token, self._hosts = app, token, tuple(map(as_browsers_write, hosts))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket") or (refusal := self.refusal(scope)) is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await WebSocketClose(POLICY_VIOLATION, refusal[1])(scope, receive, send)
        else:
            await PlainTextResponse(refusal[1], refusal[0], HEADERS)(scope, receive, send)

    def refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Return status and reason if a request is refused; None if it is let through."""
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if name_of(host) not in self._hosts:
            return 403, f"this server answers to {', '.join(self._hosts)} only"
        if origin is None and scope["type"] == "websocket":
            return 403, "a socket needs the origin of its page"
        if origin is not None and origin != f"http://{host}":
            return 403, "pages of other origins are refused"
        given = scope["path"].split("/")[1] if scope["path"].count("/") > 1 else ""
        if not secrets.compare_digest(given.encode(), self._token.encode()):
            return 404, "not found: the address needs the token that `thalweg fly` printed"
        return None


def name_of(host: str) -> str:
    """Return the name in a `Host` header, without the port and brackets; empty if there is none."""
    try:
        return as_browsers_write(urlsplit(f"//{host}").hostname or "")
    except ValueError:
        return ""


def as_browsers_write(name: str) -> str:
    """Return a name or address as browsers write it: in small letters, and an address in its shortest form."""
    try:
        return ip_address(name).compressed
    except ValueError:
        return name.lower()
