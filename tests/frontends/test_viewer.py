from dataclasses import replace

import numpy as np

from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.viewer import window_text

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
