import numpy as np
from records import record_of

from humanoid_sim.messages import Mode
from humanoid_sim.mit import MITState
from humanoid_sim.viewer import window_text


def test_a_window_says_what_it_shows():
    known, unknown = (record_of(MITState.unknown(1, 12.34), Mode.STANDBY, "ready", qpos=q) for q in (np.zeros(1), None))
    assert window_text(known, "", "12:00:00")[2:] == ("clock\ntime\nmode\nstatus", "12:00:00\n12.3 s\nSTANDBY\nready")
    assert window_text(known, "BEHIND", "12:00:00")[3].endswith("\nBEHIND")
    assert window_text(unknown, "", "12:00:00")[3].endswith("\npose unknown")
