"""From a fault on the bus back to motion, as the operator's page says."""

import os
import threading
import time

import pytest

from humanoid_sim import mode, replay
from humanoid_sim.cli import run_program
from humanoid_sim.client import running_sessions
from humanoid_sim.hardware.mock.faults import parse_fault
from humanoid_sim.messages import Mode
from humanoid_sim.robots.description import load_robot

pytestmark = pytest.mark.soak

FAULTS = {
    "bus_off": "BUS_OFF",
    "brown_out:left_elbow_pitch": "MOTOR_FAULT",
}


def send(word):
    return run_program(mode.main, [word])


@pytest.mark.parametrize("fault", FAULTS)
def test_reactivate_leads_back_to_motion(run, quick, fault, emulate):
    motors = emulate()
    answers = []

    def operator():
        while os.getpid() not in [session.process for session in running_sessions()]:
            time.sleep(0.01)
        steps = ["damp", "load_a", 1.0, "fault", 0.5, "load_a", "mend", 0.3, "reactivate", "damp", "load_a", 3.0]
        for step in [*steps, "damp", 0.3, "quit"]:
            if isinstance(step, float):
                time.sleep(step)
            elif step == "fault":
                motors[0].inject(parse_fault(fault, load_robot("lite")))
            elif step == "mend":
                motors[0].clear_faults()
            else:
                answers.append((step, send(step)))

    thread = threading.Thread(target=operator)
    thread.start()
    result = run("--robot", quick, "--hardware", "virtual:recovery", "--policy", "placeholder")
    thread.join()
    assert answers[:3] == [("damp", 0), ("load_a", 0), ("load_a", 1)]  # refused while the fault lasts
    assert answers[3:] == [(step, 0) for step in ("reactivate", "damp", "load_a", "damp", "quit")]
    modes = result.modes[result.modes.index("DAMPING") :]
    assert modes == ["DAMPING", "STANDBY", "DAMPING", "ZERO_TORQUE", "DAMPING", "STANDBY", "DAMPING"]
    assert FAULTS[fault] in result.summary["safety"][0]["message"]
    last = [tick for tick in result.ticks if tick.output.control_mode.mode is Mode.STANDBY][-1]
    assert all(status.is_ok for status in last.input.safety)
    assert last.output.standby.is_finished
    assert result.status == 1  # there was a fault that nobody asked `play` for
    assert run_program(replay.main, ["r.mcap"]) == 0
