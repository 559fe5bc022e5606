"""The page's door: who is let in, and what passes."""

import asyncio
import json
import threading
import time
from contextlib import contextmanager
from http.client import HTTPConnection

import msgspec
import pytest
from waiting import until
from websockets.asyncio.server import unix_serve
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.frontends.console import gate as module
from humanoid_sim.frontends.console.gate import Gate, checked_host


@contextmanager
def viser(path):
    """Stands for viser: sends back what it receives, and keeps it."""
    loop, stop, received = asyncio.new_event_loop(), asyncio.Event(), []

    async def handle(connection):
        async for message in connection:
            received.append(msgspec.msgpack.decode(message)["type"])
            await connection.send(message)

    async def serve():
        async with unix_serve(handle, str(path)):
            await stop.wait()

    thread = threading.Thread(target=loop.run_until_complete, args=(serve(),))
    thread.start()
    until(path.exists)
    try:
        yield received
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join()
        loop.close()


@pytest.fixture
def damps():
    return []


@pytest.fixture
def gate(tmp_path, damps):
    gate = Gate("127.0.0.1", 0, tmp_path / "viser", lambda: damps.append(1))
    yield gate
    gate.close()


def socket(gate, name, address=None, origin=""):
    return connect(
        (address or gate.control).replace("http", "ws", 1) + name, origin=origin or f"http://{gate.authority}"
    )


def packed(kind):
    return msgspec.msgpack.encode({"type": kind})


def status(gate, path, host=None):
    connection = HTTPConnection("127.0.0.1", int(gate.authority.rpartition(":")[2]))
    connection.putrequest("GET", path, skip_host=True)
    connection.putheader("Host", host or gate.authority)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


def test_the_page_is_viser_s_with_the_overlay(gate):
    for address in (gate.control, gate.watch):
        found, body = status(gate, "/" + address.split("/", 3)[3])
        assert found == 200
        assert b"NO CONNECTION" in body
        assert b"<title>Viser</title>" in body


@pytest.mark.parametrize("path", ["/", "/x/", "//", "/TOKEN", "/TOKEN/console", "/TOKEN/../x", "/TOKENx/"])
def test_without_a_whole_token_and_path_there_is_nothing(gate, path):
    assert status(gate, path.replace("TOKEN", gate.control.split("/")[3]))[0] == 404


def test_another_name_of_this_machine_is_refused(gate):
    assert status(gate, f"/{gate.control.split('/')[3]}/", host="somewhere.else")[0] == 404


@pytest.mark.parametrize(("name", "origin"), [("console", "http://x"), ("other", ""), ("console", None)])
def test_a_socket_of_another_site_or_without_an_origin_is_refused(gate, name, origin):
    with pytest.raises(InvalidStatus):
        connect(
            gate.control.replace("http", "ws", 1) + name, origin=f"http://{gate.authority}" if origin == "" else origin
        )


def test_an_overlay_is_shown_the_facts_and_damps(gate, damps):
    gate.shown = {"mode": "DAMPING", "stamp": "1", "age": 0.0}
    with socket(gate, "console-a") as page, socket(gate, "console-b", gate.watch) as watcher:
        assert json.loads(page.recv()) == {"mode": "DAMPING", "stamp": "1", "age": 0.0, "control": True}
        assert json.loads(watcher.recv())["control"] is False
        watcher.send("damp")
        page.send("damp")
        until(lambda: damps)
    assert damps == [1]


def test_only_an_operator_s_gui_and_cameras_reach_viser(gate, tmp_path):
    with viser(tmp_path / "viser") as received:
        with socket(gate, "viser-a") as page, socket(gate, "viser-b", gate.watch) as watcher:
            for one in (page, watcher):
                for kind in ("ShareUrlRequest", "GuiUpdateMessage", "ViewerCameraMessage"):
                    one.send(packed(kind))
            assert page.recv() == packed("GuiUpdateMessage"), "what viser sends comes unchanged"
            until(lambda: len(received) == 3)
        assert sorted(received) == ["GuiUpdateMessage", "ViewerCameraMessage", "ViewerCameraMessage"]


def test_commands_end_with_the_heartbeat_of_their_page_or_with_what_it_shows(gate, tmp_path, monkeypatch):
    with viser(tmp_path / "viser"), socket(gate, "viser-a") as view, socket(gate, "console-a") as page:
        assert "not heard" in gate.silence()
        view.send(packed("GuiUpdateMessage"))
        view.recv()
        now = monotonic_ns()
        page.send(str(now))
        until(lambda: gate.silence() == "")
        assert gate.seen() == now
        assert gate.heard() >= now
        page.send(str(now - 1_500_000_000))
        until(lambda: "older than 1 s" in gate.silence())
        with socket(gate, "console-b") as other:
            other.send(str(monotonic_ns()))
            time.sleep(0.05)
            assert "older" in gate.silence(), "another page's heartbeat"
        monkeypatch.setattr(module, "_HEARD_WITHIN", -1.0)
        assert "not heard" in gate.silence()


@pytest.mark.parametrize("host", ["localhost", "0.0.0.0", "::", "224.0.0.1", ""])
def test_a_host_that_is_not_one_address_is_refused(host):
    with pytest.raises(InputError, match="--host"):
        checked_host(host)


def test_an_address_that_cannot_be_served_on_is_refused(tmp_path, gate):
    port = int(gate.authority.rpartition(":")[2])
    with pytest.raises(InputError, match=f"--port {port}: cannot be served on"):
        Gate("127.0.0.1", port, tmp_path / "viser", lambda: None)
