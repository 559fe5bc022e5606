"""The page's only open door: viser's page and socket behind a token, with the operator's overlay upon it.

A token is the first part of a path; without one there is neither page nor socket. `Host` and `Origin` are compared with
the printed address, not with each other: a name that somebody else lets point to this machine passes for neither.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import json
import logging
import secrets
import threading
from collections.abc import Callable
from concurrent.futures import Future
from http import HTTPStatus
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
import viser
from websockets.asyncio.client import unix_connect
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import InputError

_VISER_PAGE = Path(viser.__file__).parent / "client" / "build" / "index.html"  # one file
_FROM_WATCHERS = frozenset({"ViewerCameraMessage"})
_FROM_OPERATORS = frozenset({"GuiUpdateMessage"})
"""Messages from pages that reach viser. Others could publish the scene through a server on the internet."""
_POLICY = (
    "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; connect-src 'self' data: blob: ws://{authority}; "
    "worker-src data: blob:; frame-ancestors 'none'"
)
"""viser's page unpacks its own scripts. It reaches no other server."""
_PERIOD = 0.1  # s between two messages to a page's overlay
_LARGEST = 1 << 16  # bytes of a page's message
_HEARD_WITHIN = 0.5  # s without a heartbeat of the page after which what it commands ends
_SEEN_WITHIN = 1.0  # s, largest age of what a page shows while it commands: two frames of a slow browser


class _Kind(msgspec.Struct):
    type: str


class Gate:
    """Serves pages on a thread of its own until it is closed. Its two tokens are new in each process."""

    def __init__(self, host: str, port: int, viser_socket: Path, damp: Callable[[], None]) -> None:
        """Serve. Raises `InputError` if the address cannot be served on.

        Args:
            host: the one address of this machine that browsers use: a page checks what it is called.
            port: 0 for one that is free.
            damp: called on the gate's thread.
        """
        self.shown: dict[str, Any] = {}
        """Facts that overlays show, such as the newest tick's `stamp`; replaced as a whole."""
        self._viser_socket, self._damp = viser_socket, damp
        self._tokens = [secrets.token_urlsafe(24) for _ in range(2)]
        self._page = _VISER_PAGE.read_bytes()
        script = resources.files("humanoid_sim.frontends.console").joinpath("overlay.js").read_bytes()
        self._page = self._page.replace(b"<head>", b"<head><script>" + script + b"</script>", 1)
        self._beats: dict[str, tuple[int, int]] = {}
        """By page: when it was heard, and the newest tick that it showed then, ns."""
        self._hand = ""
        """The page at which something was pressed or moved last."""
        self._stop = asyncio.Event()
        started: Future[int] = Future()
        serving = self._serve(host, port, started)
        self._thread = threading.Thread(target=asyncio.run, args=(serving,), name="gate", daemon=True)
        self._thread.start()
        port = started.result()
        name = f"[{host}]" if ":" in host else host
        self.authority = name if port == 80 else f"{name}:{port}"  # browsers leave the usual port out
        self.control, self.watch = (f"http://{self.authority}/{token}/" for token in self._tokens)
        """Addresses to be printed: for an operator, and for watching only."""

    def close(self) -> None:
        """End all connections and the thread."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()

    def seen(self) -> int:
        """Return the stamp of the newest tick that the operator's page showed, ns; 0 for a page that is gone."""
        return self._beats.get(self._hand, (0, 0))[1]

    def heard(self) -> int:
        """Return when the operator's page was heard last, ns; 0 for a page that is gone."""
        return self._beats.get(self._hand, (0, 0))[0]

    def silence(self) -> str:
        """Return why what the operator's page commands must end; empty while it may go on."""
        if 1e-9 * (monotonic_ns() - self.heard()) > _HEARD_WITHIN:
            return f"its page was not heard for {_HEARD_WITHIN:g} s"
        if 1e-9 * (monotonic_ns() - self.seen()) > _SEEN_WITHIN:
            return f"its page shows what is older than {_SEEN_WITHIN:g} s"
        return ""

    async def _serve(self, host: str, port: int, started: Future[int]) -> None:
        self._loop = asyncio.get_running_loop()
        quiet = logging.Logger("gate", logging.CRITICAL)  # strangers' requests are no news for an operator
        try:
            server = await serve(
                self._handle,
                host,
                port,
                process_request=self._answer,
                select_subprotocol=lambda _, offered: next(
                    (name for name in offered if name.startswith("viser-v")), None
                ),
                compression=None,
                max_size=_LARGEST,
                logger=quiet,
                close_timeout=1.0,
            )
        except (OSError, OverflowError) as error:
            started.set_exception(InputError(f"--host {host} --port {port}: cannot be served on: {error}"))
            return
        async with server:
            started.set_result(next(iter(server.sockets)).getsockname()[1])
            await self._stop.wait()

    def _admit(self, request: Request) -> tuple[bool, str] | None:
        """Return whether a request may control, and its path behind the token; None if it is not served."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
        if hosts != [self.authority]:
            return None
        if origins != [f"http://{self.authority}"] and (is_socket or origins):  # sockets of browsers always have one
            return None
        token, slash, rest = request.path.partition("?")[0].removeprefix("/").partition("/")
        kind = rest.partition("-")[0]
        if not slash or kind not in (("console", "viser") if is_socket else ("",)):
            return None
        for control, expected in zip((True, False), self._tokens, strict=True):
            if secrets.compare_digest(token.encode(errors="replace"), expected.encode()):
                return control, rest
        return None

    def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        """Answer a request; None where a socket may open."""
        admitted = self._admit(request)
        if admitted is not None and admitted[1]:
            return None
        status, body = (HTTPStatus.OK, self._page) if admitted else (HTTPStatus.NOT_FOUND, b"not found")
        headers = Headers(
            {
                "Content-Type": "text/html; charset=utf-8" if admitted else "text/plain",
                "Content-Length": str(len(body)),
                "Content-Security-Policy": _POLICY.format(authority=self.authority),
                "Cache-Control": "no-store",
                "Connection": "close",
                "Referrer-Policy": "no-referrer",
                "X-Content-Type-Options": "nosniff",
            }
        )
        return Response(status, status.phrase, headers, body)

    async def _handle(self, connection: ServerConnection) -> None:
        assert connection.request is not None
        admitted = self._admit(connection.request)
        assert admitted is not None
        control, rest = admitted
        kind, _, page = rest.partition("-")
        serve_socket = self._overlay if kind == "console" else self._view
        with contextlib.suppress(ConnectionClosed, OSError, ValueError):
            await serve_socket(connection, page, control)

    async def _overlay(self, connection: ServerConnection, page: str, control: bool) -> None:
        """Show facts at a page, and take its heartbeats, which say what it shows, and DAMP."""

        async def show() -> None:
            while True:
                await connection.send(json.dumps({**self.shown, "control": control}))
                await asyncio.sleep(_PERIOD)

        showing = asyncio.create_task(show())
        try:
            async for message in connection:
                if not control:
                    continue
                if message == "damp":
                    self._damp()
                else:
                    self._beats[page] = monotonic_ns(), int(message)
        finally:
            self._beats.pop(page, None)
            showing.cancel()
            await asyncio.gather(showing, return_exceptions=True)

    async def _view(self, outside: ServerConnection, page: str, control: bool) -> None:
        """Connect a page with viser."""
        wanted = [outside.subprotocol] if outside.subprotocol else None
        async with unix_connect(
            str(self._viser_socket), "ws://viser/", subprotocols=wanted, compression=None, max_size=None
        ) as inside:

            async def outwards() -> None:
                async for message in inside:
                    await outside.send(message)

            sending = asyncio.create_task(outwards())
            try:
                async for message in outside:
                    kind = msgspec.msgpack.decode(message, type=_Kind).type if isinstance(message, bytes) else ""
                    if control and kind in _FROM_OPERATORS:
                        self._hand = page
                        await inside.send(message)
                    elif kind in _FROM_WATCHERS:
                        await inside.send(message)
            finally:
                sending.cancel()
                await asyncio.gather(sending, return_exceptions=True)


def checked_host(host: str) -> str:
    """Return the address to serve on. Raises `InputError` if it is not one address of a machine."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        raise InputError(f"--host: is '{host}', expected an address of this machine, such as 192.168.1.20") from None
    if address.is_unspecified or address.is_multicast:
        raise InputError(f"--host: is {host}, expected the one address at which browsers reach this machine")
    return str(address)
