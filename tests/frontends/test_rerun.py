import socket
import urllib.request
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from fates import playing
from play_fixtures import quick_robot
from waiting import until

from humanoid_sim.errors import InputError
from humanoid_sim.frontends import Wanted
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.play.front_ends import wanted_front_ends
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.rerun import main, status_text

needs_rerun = pytest.mark.skipif(find_spec("rerun") is None, reason="rerun-sdk is not installed (rerun)")

RECORD = TickRecord(
    0,
    TickInput(MITState.unknown(1, 12.34)),
    TickOutput(MITCommand.zeros(1), ControlMode(Mode.STANDBY, "standby_controller_a", "ready")),
    0.0,
    False,
    np.zeros(1),
)


def test_the_status_says_what_is_shown_or_that_it_is_the_past():
    assert status_text(RECORD, "", "12:00:00") == "# STANDBY\n\nready\n\n12:00:00, robot's clock 12.3 s"
    late = status_text(replace(RECORD, qpos=None), "BEHIND: this was 1.3 s ago", "12:00:00")
    assert late.startswith("# BEHIND: this was 1.3 s ago\n")
    assert status_text(None, "", "12:00:00") == "# no tick yet\n\n12:00:00"


@needs_rerun
@pytest.mark.peers
def test_play_starts_it_in_place_of_the_window(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    assert wanted_front_ends(PlayConfig(viewer="rerun")) == (Wanted("rerun"),)


@needs_rerun
@pytest.mark.peers
def test_a_session_without_a_body_is_refused(local):
    local.tick()
    with pytest.raises(InputError, match=r"^session \d+ .*: does not describe its robot's body$"):
        main([])


@needs_rerun
@pytest.mark.peers
def test_its_page_is_served_on_this_machine_alone_and_gone_with_the_session(tmp_path, runtime):
    options = ("--robot", quick_robot(tmp_path), "--policy", "placeholder", "--script", "damp; hold 4; damp")
    with playing(tmp_path, *options, "--viewer", "rerun") as play:
        until(lambda: "rerun's page: http://127.0.0.1:" in play.said)
        address = play.said.partition("rerun's page: ")[2].split(",")[0].replace("\n", "")
        with urllib.request.urlopen(address, timeout=20.0) as answer:
            assert answer.status == 200
            assert b"<canvas" in answer.read()
        source = urlsplit(parse_qs(urlsplit(address).query)["url"][0])
        assert (source.scheme, source.hostname, source.path) == ("rerun+http", "127.0.0.1", "/proxy")
        ports = [urlsplit(address).port, source.port]
        assert [listens_elsewhere(port) for port in ports] == [False, False]
        log = play.finish()
    assert log.status == 0
    assert log.ended == {}
    for port in ports:
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(("127.0.0.1", port or 0), timeout=5.0)


def listens_elsewhere(port):
    """Whether something listens on a port at any address but 127.0.0.1."""
    lines = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()]
    listening = [words[1] for words in lines if len(words) > 3 and words[3] == "0A"]
    found = [place.partition(":")[0] for place in listening if int(place.rpartition(":")[2], 16) == port]
    assert found
    return found != ["0100007F"]
