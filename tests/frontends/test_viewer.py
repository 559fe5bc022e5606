import os
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from fates import display
from PIL import ImageGrab
from waiting import until

from humanoid_sim.errors import InputError
from humanoid_sim.frontends import Wanted
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.play.front_ends import wanted_front_ends
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.viewer import main, window_texts

RECORD = TickRecord(
    0,
    TickInput(MITState.unknown(1, 12.34)),
    TickOutput(MITCommand.zeros(1), ControlMode(Mode.STANDBY, "standby_controller_a", "ready")),
    0.0,
    False,
    np.zeros(1),
)


def test_a_window_says_what_it_shows():
    def texts(record, late=""):
        return [(left, right) for _, _, left, right in window_texts(record, late, "12:00:00")]

    present = ("clock\ntime\nmode\nstatus", "12:00:00\n12.3 s\nSTANDBY\nready")
    assert texts(RECORD) == [present]
    assert texts(RECORD, "BEHIND") == [present, ("BEHIND", "")]
    assert texts(replace(RECORD, qpos=None)) == [present, ("pose unknown", "")]
    assert texts(None) == [("clock", "12:00:00"), ("no tick yet", "")]


def test_without_a_display_it_says_so(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match=r"^viewer native: no display "):
        main(["--robot", "lite"])


@pytest.mark.parametrize(
    ("config", "wanted"),
    [
        (PlayConfig(viewer="none"), ()),
        (PlayConfig(viewer="auto"), (Wanted("viewer"),)),
        (PlayConfig(viewer="auto", hardware="virtual:x"), ()),
        (PlayConfig(viewer="native", hardware="virtual:x"), (Wanted("viewer"),)),
    ],
)
def test_the_window_is_a_process_of_its_own(config, wanted, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    assert wanted_front_ends(config) == wanted


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="Xvfb is not installed (xvfb)")
def test_a_robot_without_a_session_has_a_window_that_draws_it_and_ends_with_its_display(runtime):
    """In a process of its own: a window leaves GLFW, and its display, behind."""
    with display() as (server, screen):
        command = [sys.executable, "-m", "humanoid_sim.viewer", "--robot", "lite"]
        environment = {**os.environ, "DISPLAY": screen}
        with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as viewer:
            try:
                said = viewer.stdout.readline()
                assert said == "window of lite: its joints are in the panel on the right, under Joint\n"
                until(lambda: len(colours(screen)) > 100)  # a robot, a floor and a panel; an empty screen has one
                assert viewer.poll() is None
                server.kill()
                assert viewer.wait(60.0) != 0
            finally:
                viewer.kill()


def colours(screen):
    """Those that a display shows."""
    picture = ImageGrab.grab(xdisplay=screen).convert("RGB")
    return {colour for _, colour in picture.getcolors(picture.width * picture.height) or ()}
