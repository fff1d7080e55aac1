"""The local server: one page, its parts by number, and a websocket for decisions."""

import asyncio
import html
import json
import secrets
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from pathlib import Path
from typing import Any, NamedTuple

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.page.data import shipped_dial
from socialiq.page.write import ASSETS, core, embedded, framed, of_dial, page, policy, program
from socialiq.view import Decide, View

ADDRESS = "127.0.0.1"
TOKEN_BYTES = 24  # 192 bits of the address

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


class Guard:
    """An ASGI application that passes on what its own page asks, and refuses all else."""

    def __init__(self, app: App, port: int, token: str) -> None:
        self._app = app
        self._token = token
        self._host = f"{ADDRESS}:{port}"
        self._origin = f"http://{self._host}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, or one websocket."""
        if scope["type"] not in ("http", "websocket"):
            return
        status, reason = self._fault(scope)
        if status:
            if scope["type"] == "websocket":
                await receive()
                # Before it opens: 403.
                await send({"type": "websocket.close", "code": 1008, "reason": reason})
                return
            headers = _encoded({**HEADERS, "content-type": "text/plain; charset=utf-8"})
            await send({"type": "http.response.start", "status": status, "headers": headers})
            await send({"type": "http.response.body", "body": f"{reason}\n".encode()})
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


OWN = Path(__file__).with_name("assets")


class Front(NamedTuple):
    """A page as HTML, and its content security policy: its own script, styles and server alone."""

    text: str
    policy: str


def front(view: View, socket_address: str) -> Front:
    """Return the page that shows a view, whose texts may hold anything.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    script = program("opened", OWN)
    style = (ASSETS / "style.css").read_text(encoding="utf-8") + _asset("opened.css")
    about = {"kind": view.kind, "count": view.count, **view.data}
    blocks = {
        "policy": "",
        "style": style,
        "title": html.escape(view.title),
        "lead": html.escape(view.lead),
        "controls": _asset("controls.html"),
        "data": embedded({**of_dial(shipped_dial()), **core(view.options), "shown": about}),
        "program": script,
    }
    text = framed(_asset("opened.html"), _asset(f"{view.kind}.html") + "\n", blocks)
    allowed = policy(script, style, f"'self' {socket_address}")
    return Front(text, f"{allowed}; frame-ancestors 'none'")


def _asset(name: str) -> str:
    return (OWN / name).read_text(encoding="utf-8")


MOST_BYTES = 1 << 20
"""Largest question of the page, bytes: 64 observations have 90 kB."""

BUSY = 4001
"""Code by which a second tab is told that the policy answers another one."""


def check_extra() -> None:
    """Refuse to go on without the libraries of the server.

    Raises:
        UserError: If the extra `web` is not installed.
    """
    starlette = ("applications", "responses", "routing")
    for name in (*(f"starlette.{module}" for module in starlette), "uvicorn", "websockets"):
        optional(name, "web", "view")


def bound(port: int) -> socket.socket:
    """Return a listening socket at 127.0.0.1, which no other machine reaches; port 0 is a free one.

    Raises:
        UserError: If the port is taken, or not a port for users.
    """
    if port and not 1024 <= port <= 65535:
        raise UserError(f"--port {port}: give one from 1024 to 65535, or leave it out")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((ADDRESS, port))
        listening.listen(64)
    except OSError as error:
        listening.close()
        raise UserError(
            f"cannot listen at {ADDRESS}:{port}: {error.strerror}; name another --port, or leave "
            "it out"
        ) from error
    return listening


def application(view: View | None, port: int, token: str) -> App:
    """Return the ASGI application that shows a view, or the page of the shipped dial alone.

    It refuses what the page did not ask. It listens at the port, below the token in its address.

    Raises:
        UserError: If the extra `web` is not installed.
    """
    applications = optional("starlette.applications", "web", "view")
    responses = optional("starlette.responses", "web", "view")
    routing = optional("starlette.routing", "web", "view")
    socket_address = f"ws://{ADDRESS}:{port}/{token}/decide"
    # The dial's page holds a policy of its own too, which forbids every request.
    alone = Front(page(), "frame-ancestors 'none'")
    text, policy = alone if view is None else front(view, socket_address)

    async def index(_: Any) -> Any:
        return responses.HTMLResponse(text, headers={"content-security-policy": policy})

    async def dial(_: Any) -> Any:
        return responses.HTMLResponse(alone.text, headers={"content-security-policy": alone.policy})

    async def part(request: Any) -> Any:
        text = request.path_params["number"]
        # Python refuses to read a number of thousands of digits.
        number = int(text) if text.isascii() and text.isdigit() and len(text) < 16 else -1
        if view is None or not 0 <= number < view.count:
            return responses.PlainTextResponse("there is no such part\n", 404)
        try:
            return responses.JSONResponse(await asyncio.to_thread(view.part, number))
        except UserError as error:
            return responses.JSONResponse({"fault": one_line(str(error))}, 422)

    routes = [
        routing.Route("/", index),
        routing.Route("/dial", dial),
        routing.Route("/part/{number}", part),
    ]
    if view is not None and view.decide is not None:
        routes.append(routing.WebSocketRoute("/decide", _Conversation(view.decide).hold))
    mounted = [routing.Mount(f"/{token}", routes=routes)]
    return Guard(applications.Starlette(routes=mounted), port, token)


class _Conversation:
    """Questions of one tab and their answers, in order; a second tab is told so."""

    def __init__(self, decide: Decide) -> None:
        self._decide = decide
        self._held = False

    async def hold(self, tab: Any) -> None:
        """Answer a tab until it is closed."""
        await tab.accept()
        if self._held:
            await tab.close(BUSY, "another tab has this policy")
            return
        self._held = True
        try:
            while (message := await tab.receive())["type"] == "websocket.receive":
                answer = await self._answer(message.get("text") or "")
                await tab.send_text(json.dumps(answer, allow_nan=False))
        finally:
            self._held = False

    async def _answer(self, text: str) -> dict[str, Any]:
        number = None
        try:
            try:
                question = json.loads(text)
            except (ValueError, RecursionError):
                question = None
            number = question.get("number") if isinstance(question, dict) else None
            if not isinstance(question, dict) or not isinstance(number, int):
                number = None
                raise UserError("the page asked in a way that is not known: reload it")
            answer = await asyncio.to_thread(self._decide, question)
        except UserError as error:
            return {"number": number, "fault": one_line(str(error), 400)}
        return {"number": number, **answer}


HEADER_SECONDS = 10.0
"""Time in which a connection has to send the headers of its first request."""


def serve(view: View | None, port: int, opened: Callable[[str], None]) -> None:
    """Serve a view, or the page of the shipped dial alone, until Ctrl-C; `opened` gets the address.

    Raises:
        UserError: If the extra `web` is not installed, or the port is taken.
    """
    check_extra()
    uvicorn = optional("uvicorn", "web", "view")
    token = secrets.token_urlsafe(TOKEN_BYTES)
    listening = bound(port)
    with listening:
        number = listening.getsockname()[1]
        base = optional("uvicorn.protocols.http.h11_impl", "web", "view").H11Protocol

        class HeaderTimeout(base):
            def connection_made(self, transport: Any) -> None:
                super().connection_made(transport)

                def close_if_silent() -> None:
                    if transport.get_protocol() is self and self.cycle is None:
                        transport.close()

                self.loop.call_later(HEADER_SECONDS, close_if_silent)

        settings = uvicorn.Config(
            application(view, number, token),
            log_level="error",
            access_log=False,
            lifespan="off",
            proxy_headers=False,
            server_header=False,
            http=HeaderTimeout,
            ws="websockets-sansio",
            ws_max_size=MOST_BYTES,
            limit_concurrency=64,
            timeout_graceful_shutdown=2,
        )
        opened(f"http://{ADDRESS}:{number}/{token}/")
        try:
            uvicorn.Server(settings).run(sockets=[listening])
        except KeyboardInterrupt:  # how it ends
            return
