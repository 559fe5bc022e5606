from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

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
