"""The console's only open door: pages and sockets on one address, each request checked by a `Gate`."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
from collections import Counter
from collections.abc import Awaitable, Callable
from http import HTTPStatus
from importlib import resources
from pathlib import Path
from typing import Any

import websockets.exceptions
from websockets.asyncio.client import unix_connect
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from humanoid_sim.errors import InputError
from humanoid_sim.files import finite
from humanoid_sim.frontends.console.access import Access, Gate, RefusedError
from humanoid_sim.frontends.console.scene import VISER_PAGE, may_pass

PageHandler = Callable[[ServerConnection, Access], Awaitable[None]]
_MOST_SOCKETS = 32
"""Largest number of open sockets, two of each page: its own and its view's."""
_MOST_WATCHING = 24
"""Largest number of those that are for watching only; the others are kept for operators."""
_LONGEST = 1 << 16
"""Bytes of a page's message."""
_TYPES = {".html": "text/html; charset=utf-8", ".js": "text/javascript; charset=utf-8", ".css": "text/css"}
"""Types of the files in this package that are served, by their suffixes."""
_PLOTLY = "plotly.js"
"""Script that draws the plots, from the package plotly: nothing is loaded from elsewhere."""
_OWN_POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self' {socket}; "
    "frame-ancestors 'none'; base-uri 'none'"
)
"""Plotly gives its drawings styles of their own."""
_VISER_POLICY = (
    "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; connect-src 'self' data: blob: {socket}; "
    "worker-src data: blob:; frame-ancestors 'self'"
)
"""viser's page unpacks its own scripts. Neither page reaches any other server."""


class _Door:
    gate: Gate
    """Gate that is known once the port is."""

    def __init__(self, viser_socket: Path, page: PageHandler) -> None:
        self._viser_socket, self._page = viser_socket, page
        self._admitted: dict[Any, tuple[Access, str]] = {}
        self._open: Counter[Access] = Counter()
        package = resources.files("humanoid_sim.frontends.console")
        self._files = {file.name: file.read_bytes() for file in package.iterdir() if Path(file.name).suffix in _TYPES}
        self._files[_PLOTLY] = (resources.files("plotly") / "package_data" / "plotly.min.js").read_bytes()
        self._viser_page = VISER_PAGE.read_bytes()

    def check(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the answer to a request; None where a socket may open."""
        is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
        try:
            access, rest = self.gate.admit(
                request.path,
                request.headers.get_all("Host"),
                request.headers.get_all("Origin"),
                is_socket=is_socket,
            )
            if is_socket:
                if rest not in ("console", "viser"):
                    raise RefusedError(404, "not found")
                watching = self._open[Access.READ_ONLY]
                if access is Access.READ_ONLY and watching >= _MOST_WATCHING:
                    raise RefusedError(503, f"{_MOST_WATCHING // 2} pages are open for watching, the most there may be")
                if self._open.total() >= _MOST_SOCKETS:
                    raise RefusedError(503, f"{_MOST_SOCKETS // 2} pages are open, the most there may be")
                self._admitted[connection.id] = access, rest
                return None
            path = request.path.partition("?")[0]
            if not rest and not path.endswith("/"):  # a page's own files are found from its folder alone
                return _response(307, "text/plain", b"", "default-src 'none'", Location=f"{path}/")
            return self._file(rest or "page.html")
        except RefusedError as refused:
            return _response(refused.status, "text/plain", str(refused).encode(), "default-src 'none'")

    def _file(self, name: str) -> Response:
        socket = f"ws://{self.gate.authority}"
        if name == "viser/":
            return _response(200, _TYPES[".html"], self._viser_page, _VISER_POLICY.format(socket=socket))
        if name not in self._files:
            raise RefusedError(404, "not found")
        return _response(200, _TYPES[Path(name).suffix], self._files[name], _OWN_POLICY.format(socket=socket))

    async def handle(self, connection: ServerConnection) -> None:
        """Serve a socket that was let in."""
        access, rest = self._admitted.pop(connection.id)
        self._open[access] += 1
        try:
            with contextlib.suppress(websockets.exceptions.ConnectionClosed, OSError):
                await (self._page(connection, access) if rest == "console" else self._view(connection))
        finally:
            self._open[access] -= 1

    async def _view(self, outside: ServerConnection) -> None:
        """Between a page's view and viser."""
        wanted = [outside.subprotocol] if outside.subprotocol else None
        options = {"subprotocols": wanted, "compression": None, "max_size": None}
        async with unix_connect(str(self._viser_socket), "ws://viser/", **options) as viser:

            async def outwards() -> None:
                async for message in viser:
                    await outside.send(message)

            sending = asyncio.create_task(outwards())
            try:
                async for message in outside:
                    if may_pass(message):
                        await viser.send(message)
            finally:
                sending.cancel()
                await asyncio.gather(sending, return_exceptions=True)


def _response(status: int, kind: str, body: bytes, policy: str, **more: str) -> Response:
    headers = {
        "Content-Type": kind,
        "Content-Length": str(len(body)),
        "Content-Security-Policy": policy,
        "Cache-Control": "no-store",
        "Connection": "close",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        **more,
    }
    return Response(status, HTTPStatus(status).phrase, Headers(headers), body)


@contextlib.asynccontextmanager
async def serving(host: str, port: int, viser_socket: Path, page: PageHandler) -> Any:
    """Serve until the end of the block; gives the `Gate`, whose addresses are to be printed.

    Args:
        port: 0 for one that is free.
        page: looks after the socket of one page.

    Raises:
        InputError: the address cannot be served on.
    """
    door = _Door(viser_socket, page)
    quiet = logging.Logger("console", logging.CRITICAL)  # strangers' requests are no news for an operator

    def viser_protocol(_: ServerConnection, offered: list[str]) -> str | None:
        return next((name for name in offered if name.startswith("viser-v")), None)

    try:
        server = await serve(
            door.handle,
            host,
            port,
            process_request=door.check,
            select_subprotocol=viser_protocol,
            compression=None,
            max_size=_LONGEST,
            logger=quiet,
            close_timeout=1.0,
            start_serving=False,
        )
    except (OSError, OverflowError) as error:
        raise InputError(f"--host {host} --port {port}: cannot be served on: {error}") from None
    async with server:
        door.gate = Gate(host, next(iter(server.sockets)).getsockname()[1])
        await server.start_serving()
        yield door.gate


def encoded(value: object) -> str:
    """JSON for a page; what is not finite is null there."""
    return json.dumps(finite(value), separators=(",", ":"))
