from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.viewer import main, window_text

RECORD = TickRecord(
    0,
    TickInput(MITState.unknown(1, 12.34)),
    TickOutput(MITCommand.zeros(1), ControlMode(Mode.STANDBY, "standby_controller_a", "ready")),
    0.0,
    False,
    np.zeros(1),
)


def test_a_window_says_what_it_shows():
    assert window_text(RECORD, "", "12:00:00")[2:] == ("clock\ntime\nmode\nstatus", "12:00:00\n12.3 s\nSTANDBY\nready")
    assert window_text(RECORD, "BEHIND", "12:00:00")[3].endswith("\nBEHIND")
    assert window_text(replace(RECORD, qpos=None), "", "12:00:00")[3].endswith("\npose unknown")
    assert window_text(None, "", "12:00:00")[2:] == ("clock", "12:00:00, no tick yet")


def test_without_a_display_it_says_so(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match=r"^viewer native: no display"):
        main(["--robot", "lite"])
