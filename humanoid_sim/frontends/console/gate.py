"""The page's only open door: viser's page and socket behind a token, with the operator's overlay upon it.

The token is the first part of a path; without it there is neither page nor socket. `Host` and `Origin` are compared
with the printed address, not with each other: a name that somebody else lets point to this machine passes for neither.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import logging
import secrets
import socket
from collections.abc import Awaitable, Callable
from http import HTTPStatus
from importlib import resources
from pathlib import Path
from typing import Any
from unittest.mock import patch

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import blaming

_VISER_PAGE = Path(viser.__file__).parent / "client" / "build" / "index.html"  # one file
_HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    # viser's page unpacks its own scripts. It reaches no other server.
    "Content-Security-Policy": "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
}
_PERIOD = 0.1  # s between two messages to a page's overlay
_BEAT_WITHIN = 0.5  # s without a heartbeat of the page after which what it commands ends
_SEEN_WITHIN = 1.0  # s, largest age of what a page shows while it commands: two frames of a slow browser


class Gate:
    """One address of this machine, with a token that is new in each process."""

    def __init__(self, host: str, port: int) -> None:
        """Listen. Raises `InputError` if the address cannot be served on; port 0 is one that is free."""
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        with blaming(f"--host {host} --port {port}: cannot be served on", (OSError, OverflowError)):
            self._socket = socket.create_server((host, port), family=family)
        name = f"[{host}]" if ":" in host else host
        self.authority = f"{name}:{self._socket.getsockname()[1]}"
        self._token = secrets.token_urlsafe(24)
        self.address = f"http://{self.authority}/{self._token}/"
        self.shown: dict[str, Any] = {}
        """Facts that overlays show, such as the newest tick's `stamp`; replaced as a whole."""
        self.damp: Callable[[], None] = lambda: None
        """Called on viser's thread."""
        script = resources.files("humanoid_sim.frontends.console").joinpath("overlay.js").read_text("utf-8")
        self._page = _VISER_PAGE.read_text("utf-8").replace("<head>", f"<head><script>{script}</script>", 1)
        # By overlay: its latest heartbeat, and the newest tick that it showed then, ns.
        self._beats: dict[ServerConnection, tuple[int, int]] = {}
        self._hand: ServerConnection | None = None  # overlay of the page at which something was pressed last

    def serve(self) -> viser.ViserServer:
        """Start viser, which would open a port that any page of a local browser could reach, behind the gate."""
        serve = websockets.asyncio.server.serve

        def guarded(handler: Callable[[ServerConnection], Awaitable[None]], *_: Any, **options: Any) -> Any:
            async def handle(connection: ServerConnection) -> None:
                assert connection.request is not None
                await (self._overlay if connection.request.path.endswith("/console") else handler)(connection)

            quiet = logging.Logger("gate", logging.CRITICAL)  # strangers' requests are no news for an operator
            options |= {"process_request": self._answer, "logger": quiet}
            return serve(handle, sock=self._socket, **options)

        with patch.object(websockets.asyncio.server, "serve", guarded), contextlib.redirect_stdout(io.StringIO()):
            return viser.ViserServer("", 0, verbose=False)

    def seen(self) -> int:
        """Return the stamp of the newest tick that the operator's page showed, ns; 0 for a page that is gone."""
        return 0 if self._hand is None else self._beats.get(self._hand, (0, 0))[1]

    def heartbeat(self) -> int:
        """Return the time of the latest heartbeat of the operator's page, ns; 0 for a page that is gone."""
        return 0 if self._hand is None else self._beats.get(self._hand, (0, 0))[0]

    def silence(self) -> str:
        """Return why what the operator's page commands must end; empty while it may go on."""
        if 1e-9 * (monotonic_ns() - self.heartbeat()) > _BEAT_WITHIN:
            return f"no heartbeat of its page for {_BEAT_WITHIN:g} s"
        if 1e-9 * (monotonic_ns() - self.seen()) > _SEEN_WITHIN:
            return f"its page shows what is older than {_SEEN_WITHIN:g} s"
        return ""

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request; None where a socket may open."""
        is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
        if not self._is_admitted(request, is_socket=is_socket):
            if request.headers.get_all("Host") == [self.authority] or not self._has_token(request.path):
                return connection.respond(HTTPStatus.NOT_FOUND, "not found")
            text = f"open it at {self.authority}: through a proxy or a tunnel its address must be the same (--port)"
            return connection.respond(HTTPStatus.FORBIDDEN, text)
        if is_socket:
            return None
        response = connection.respond(HTTPStatus.OK, self._page)
        del response.headers["Content-Type"]
        response.headers.update(_HEADERS)
        return response

    def _is_admitted(self, request: Request, *, is_socket: bool) -> bool:
        origins = request.headers.get_all("Origin")
        if request.headers.get_all("Host") != [self.authority]:
            return False
        if origins != [f"http://{self.authority}"] and (is_socket or origins):  # sockets of browsers always have one
            return False
        _, slash, kind = request.path.partition("?")[0].removeprefix("/").partition("/")
        return self._has_token(request.path) and bool(slash) and kind in (("console", "viser") if is_socket else ("",))

    def _has_token(self, path: str) -> bool:
        token = path.partition("?")[0].removeprefix("/").partition("/")[0]
        return secrets.compare_digest(token.encode(errors="replace"), self._token.encode())

    async def _overlay(self, connection: ServerConnection) -> None:
        """Show facts at a page, and receive its presses, DAMP, and its heartbeats: the stamp of what it shows."""

        async def show() -> None:
            while True:
                await connection.send(json.dumps(self.shown))
                await asyncio.sleep(_PERIOD)

        showing = asyncio.create_task(show())
        try:
            with contextlib.suppress(ConnectionClosed, ValueError):
                async for message in connection:
                    if message == "damp":
                        self.damp()
                    elif message == "hand":
                        self._hand = connection
                    else:
                        self._beats[connection] = monotonic_ns(), int(message)
                    if self._hand is None:  # no other page goes on for one that is gone
                        self._hand = connection
        finally:
            self._beats.pop(connection, None)
            showing.cancel()
            await asyncio.gather(showing, return_exceptions=True)
