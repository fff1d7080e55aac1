"""The local server: one page, its parts by number, and a websocket for decisions."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.page.write import page
from socialiq.view.front import Front, front
from socialiq.view.guard import ADDRESS, App, Guard, new_token
from socialiq.view.shown import Decide, Shown

MOST_BYTES = 1 << 20
"""Largest question of the page, bytes: 64 observations have 90 kB."""

BUSY = 4001
"""Code by which a second tab is told that the policy answers another one."""


_LIBRARIES = (
    "starlette.applications",
    "starlette.responses",
    "starlette.routing",
    "uvicorn",
    "websockets",
)


def check_extra() -> None:
    """Refuse to go on without the libraries of the server.

    Raises:
        UserError: If the extra `web` is not installed.
    """
    for name in _LIBRARIES:
        optional(name, "web", "view")


def bound(port: int) -> socket.socket:
    """Return a listening socket at 127.0.0.1, which no other machine reaches.

    Args:
        port: Port; 0 takes a free one.

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


def application(shown: Shown | None, port: int, token: str) -> App:
    """Return the ASGI application that shows something, and refuses what the page did not ask.

    Args:
        shown: What is shown; None for the page of the shipped dial alone.
        port: Port at which it listens.
        token: Token of the address.

    Raises:
        UserError: If the extra `web` is not installed.
    """
    applications = optional("starlette.applications", "web", "view")
    responses = optional("starlette.responses", "web", "view")
    routing = optional("starlette.routing", "web", "view")
    socket_address = f"ws://{ADDRESS}:{port}/{token}/decide"
    # The dial's page holds a policy of its own too, which forbids every request.
    alone = Front(page(), "frame-ancestors 'none'")
    text, policy = alone if shown is None else front(shown, socket_address)

    async def whole(_: Any) -> Any:
        return responses.HTMLResponse(text, headers={"content-security-policy": policy})

    async def dial(_: Any) -> Any:
        return responses.HTMLResponse(alone.text, headers={"content-security-policy": alone.policy})

    async def part(request: Any) -> Any:
        number = request.path_params["number"]
        if shown is None or not 0 <= number < shown.count:
            return responses.PlainTextResponse("there is no such part\n", 404)
        try:
            return responses.JSONResponse(await asyncio.to_thread(shown.part, number))
        except UserError as error:
            return responses.JSONResponse({"fault": one_line(str(error))}, 422)

    routes = [
        routing.Route("/", whole),
        routing.Route("/dial", dial),
        routing.Route("/part/{number:int}", part),
    ]
    if shown is not None and shown.decide is not None:
        routes.append(routing.WebSocketRoute("/decide", _Conversation(shown.decide).hold))
    mounted = [routing.Mount(f"/{token}", routes=routes)]
    return Guard(applications.Starlette(routes=mounted), port, token)


class _Conversation:
    """Questions of one tab and their answers, in order; a second tab is told so.

    A policy may be a process with one pipe, so that it answers one question at a time.
    """

    def __init__(self, decide: Decide) -> None:
        self._decide, self._held = decide, False

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
            question = _object(text)
            number = question.get("number")
            answer = await asyncio.to_thread(self._decide, question)
        except UserError as error:
            return {"number": number, "fault": one_line(str(error), 400)}
        return {"number": number, **answer}


def _object(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        content = None
    number = content.get("number") if isinstance(content, dict) else None
    if not isinstance(content, dict) or not isinstance(number, int):
        raise UserError("the page asked in a way that is not known: reload it")
    return content


def serve(shown: Shown | None, port: int, opened: Callable[[str], None]) -> None:
    """Serve until Ctrl-C.

    Args:
        shown: What is shown; None for the page of the shipped dial alone.
        port: Port at 127.0.0.1; 0 takes a free one.
        opened: Called with the address once the server listens.

    Raises:
        UserError: If the extra `web` is not installed, or the port is taken.
    """
    check_extra()
    uvicorn = optional("uvicorn", "web", "view")
    token, listening = new_token(), bound(port)
    with listening:
        number = listening.getsockname()[1]
        settings = uvicorn.Config(
            application(shown, number, token),
            log_level="error",
            access_log=False,
            lifespan="off",
            proxy_headers=False,
            server_header=False,
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
