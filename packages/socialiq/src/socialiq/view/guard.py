"""Refusals of the local server: other hosts, other origins, requests without the token.

The server listens at 127.0.0.1, which every program and every web page that is open on the machine
can reach. A page of another site can send requests to it, and a name that its owner lets point to
127.0.0.1 makes them look as if they were of one origin (DNS rebinding). So a request must name this
very address as its host, come from no other origin, and know the token, which is drawn at each
start and stands in the address alone.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

ADDRESS = "127.0.0.1"
TOKEN_BYTES = 24

HEADERS = {
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}
"""Headers of every answer: nothing is kept, embedded elsewhere, or told to another site."""

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


def new_token() -> str:
    """Return a random token of 192 bits, as text for an address."""
    return secrets.token_urlsafe(TOKEN_BYTES)


class Guard:
    """An ASGI application that passes on what its own page asks, and refuses all else.

    Args:
        app: The application; its paths lie below the token.
        port: Port at which the server listens.
        token: Token of the address.
    """

    def __init__(self, app: App, port: int, token: str) -> None:
        self._app, self._token = app, token
        self._host = f"{ADDRESS}:{port}"
        self._origin = f"http://{self._host}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, or one websocket."""
        if scope["type"] not in ("http", "websocket"):
            return
        status, reason = self._fault(scope)
        if status:
            await _refuse(scope, receive, send, status, reason)
            return

        async def send_with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *_encoded(HEADERS)]
            await send(message)

        await self._app(scope, receive, send_with_headers)

    def _fault(self, scope: Scope) -> tuple[int, str]:
        """Return status and reason of a refusal; status 0 if the request is accepted."""
        headers = scope["headers"]
        if _values(headers, b"host") != [self._host]:
            return 421, "this server answers at its own address alone"
        origins = _values(headers, b"origin")
        needed = scope["type"] == "websocket"  # browsers name the origin of every websocket
        if (needed or origins) and origins != [self._origin]:
            return 403, "this server answers its own page alone"
        if _values(headers, b"sec-fetch-site") not in ([], ["same-origin"], ["none"]):
            return 403, "this server answers its own page alone"
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD"):
            return 405, "this server changes nothing: ask by GET"
        first = scope["path"].encode("utf-8", "surrogateescape").split(b"/")[1:2]
        if not first or not secrets.compare_digest(first[0], self._token.encode()):
            return 404, "nothing is here: open the address that `socialiq view` printed"
        return 0, ""


def _values(headers: list[tuple[bytes, bytes]], name: bytes) -> list[str]:
    """Return the values of all headers of a name, in lower case as host names are compared."""
    return [value.decode("latin-1").lower() for key, value in headers if key.lower() == name]


def _encoded(headers: dict[str, str]) -> list[tuple[bytes, bytes]]:
    return [(name.encode(), value.encode()) for name, value in headers.items()]


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, reason: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send(
            {"type": "websocket.close", "code": 1008, "reason": reason}
        )  # before it opens: 403
        return
    headers = {**HEADERS, "content-type": "text/plain; charset=utf-8"}
    await send({"type": "http.response.start", "status": status, "headers": _encoded(headers)})
    await send({"type": "http.response.body", "body": f"{reason}\n".encode()})
