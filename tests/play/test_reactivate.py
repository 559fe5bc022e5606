"""`mode reactivate` to a running session, and the replay of what was recorded."""

import os
import threading
import time

import pytest

from humanoid_sim import mode, replay
from humanoid_sim.cli import run_program
from humanoid_sim.client import running_sessions
from humanoid_sim.messages import Mode

pytestmark = pytest.mark.soak

DONE = "reactivated: the robot is verified and enabled afresh"


def test_a_session_begins_again_and_its_recording_replays(run, quick):
    statuses = []

    def operator():
        while os.getpid() not in [session.process for session in running_sessions()]:
            time.sleep(0.01)
        for word, pause in (("damp", 0.2), ("load_a", 0.1), ("reactivate", 0.1), ("damp", 0.2), ("reactivate", 0.1)):
            statuses.append(run_program(mode.main, [word]))
            time.sleep(pause)
        statuses.extend(run_program(mode.main, [word]) for word in ("damp", "load_b", "quit", "damp", "quit"))

    thread = threading.Thread(target=operator)
    thread.start()
    result = run("--robot", quick, "--policy", "placeholder", "--script", "hold 60", "--pace", "realtime")
    thread.join()
    assert statuses == [0, 0, 1, 0, 0, 0, 0, 1, 0, 0]
    assert result.modes[result.modes.index("DAMPING") :] == [  # the first DAMP may come before the first tick
        "DAMPING",
        "STANDBY",
        "DAMPING",
        "ZERO_TORQUE",
        "DAMPING",
        "STANDBY",
        "DAMPING",
    ]
    events = [event.text for event in result.events if "requested by mode" not in event.text]
    assert events == ["REACTIVATE refused: requires ZERO_TORQUE or DAMPING, mode is STANDBY", DONE, "ending: QUIT"]
    modes = [tick.output.control_mode.mode for tick in result.ticks]
    afresh = modes.index(Mode.ZERO_TORQUE, modes.index(Mode.DAMPING))
    assert modes[afresh - 1] is Mode.DAMPING
    assert DONE in result.out
    assert run_program(replay.main, ["r.mcap"]) == 0
