import shutil
import subprocess
import sys

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.rendering.native_viewer import NativeViewerSink

UNDER_XVFB = """
import time
import mujoco, numpy as np
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.rendering.native_viewer import NativeViewerSink
from humanoid_sim.messages import SessionHeader, TickRecord

xml = "<mujoco><worldbody><body><joint/><geom size='0.1'/></body></worldbody></mujoco>"
sink = NativeViewerSink(lambda: mujoco.MjModel.from_xml_string(xml))
sink.start(SessionHeader("ball", ("joint",), 0.005, 0))
slowest = 0.0
for index in range(100):
    output = TickOutput(MITCommand.zeros(1), ControlMode(Mode.DAMPING, "damping_controller"))
    record = TickRecord(index, TickInput(MITState.unknown(1, index / 200)), output, 0.0, False, np.full(1, index / 100))
    before = time.perf_counter()
    sink.tick(record)
    slowest = max(slowest, time.perf_counter() - before)
    time.sleep(0.005)
assert not sink.closed
sink.close()
sink.close()
assert sink.closed
print("slowest tick under 50 ms:", slowest < 0.05)
"""


def test_without_a_display_it_says_what_to_use_instead(pendulum, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match=r"^viewer native: no display .*; --html out\.html shows the run"):
        NativeViewerSink(lambda: pendulum)


def test_a_display_that_does_not_answer_is_refused_too(pendulum, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":4711")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match=r"^viewer native: the display opens no window \(.+\); --html out\.html"):
        NativeViewerSink(lambda: pendulum)


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="xvfb-run is not installed (xvfb)")
def test_a_window_opens_follows_and_closes():
    # In a process of its own: a window leaves GLFW, and its display, behind.
    done = subprocess.run(
        ["xvfb-run", "-a", sys.executable, "-c", UNDER_XVFB], check=False, capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stdout.strip()) == (0, "slowest tick under 50 ms: True"), done.stderr
