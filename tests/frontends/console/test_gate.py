"""The page's door: who is let in, and what passes."""

import json
import time
from contextlib import closing
from http.client import HTTPConnection

import pytest
from waiting import until
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from humanoid_sim.errors import InputError
from humanoid_sim.frontends.console import gate as module
from humanoid_sim.frontends.console.gate import Gate


@pytest.fixture
def gate():
    gate = Gate("127.0.0.1", 0)
    server = gate.serve()
    yield gate
    server.stop()


def socket(gate, origin="own"):
    address = gate.address.replace("http", "ws", 1) + "console"
    return connect(address, origin=f"http://{gate.authority}" if origin == "own" else origin)


def status(gate, path, **headers):
    with closing(HTTPConnection(gate.authority)) as connection:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read()


def test_the_page_is_viser_s_with_the_overlay_and_behind_a_proxy_its_address_for_who_has_the_token(gate):
    path = "/" + gate.address.split("/", 3)[3]
    found, body = status(gate, path)
    assert found == 200
    assert b"NO CONNECTION" in body
    assert b"<title>Viser</title>" in body
    found, body = status(gate, path, Host="robot.local")
    assert (found, gate.authority in body.decode()) == (403, True)
    assert status(gate, "/x/", Host="robot.local") == (404, b"not found")


def test_an_overlay_is_shown_the_facts_and_damps(gate):
    gate.shown, damps = {"mode": "DAMPING", "stamp": "1", "age": 0.0}, []
    gate.damp = lambda: damps.append(1)
    with socket(gate) as page:
        assert json.loads(page.recv()) == gate.shown
        page.send("damp")
        until(lambda: damps)
    with pytest.raises(InvalidStatus):
        socket(gate, origin=None)


def test_commands_end_with_the_heartbeat_of_their_page_or_with_what_it_shows(gate, monkeypatch):
    now = 10**12
    monkeypatch.setattr(module, "monotonic_ns", lambda: now)
    with socket(gate) as page:
        assert "no heartbeat" in gate.silence()
        page.send(str(now))
        until(lambda: gate.silence() == "")
        assert (gate.seen(), gate.heartbeat()) == (now, now)
        with socket(gate) as other:
            other.send(str(now + 1))
            page.send(str(now - 1_500_000_000))
            until(lambda: "older than 1 s" in gate.silence())
            time.sleep(0.02)
            assert "older" in gate.silence(), "another page's heartbeat"
            other.send("hand")
            until(lambda: gate.seen() == now + 1)
        until(lambda: gate.seen() == 0)
        page.send(str(now))
        time.sleep(0.02)
        assert gate.seen() == 0, "the page of an operator who is gone is replaced by a press only"
        page.send("hand")
        until(lambda: gate.silence() == "")
        now += 600_000_000
        assert "no heartbeat" in gate.silence()


def test_an_address_that_cannot_be_served_on_is_refused(gate):
    port = int(gate.authority.rpartition(":")[2])
    with pytest.raises(InputError, match=f"--port {port}: cannot be served on"):
        Gate("127.0.0.1", port)
