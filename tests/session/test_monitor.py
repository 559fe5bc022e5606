from dataclasses import replace

import numpy as np
import rig
from fakes import HEADER

from humanoid_sim.evaluation.run_figures import JointUse
from humanoid_sim.messages import (
    ControlMode,
    FaultReport,
    Mode,
    SafetyFlag,
    SafetyLevel,
    SafetyStatus,
    TickInput,
    TickOutput,
    TickRecord,
)
from humanoid_sim.session.monitor import RunMonitor

LIMIT = np.array([10.0, 10.0, 4.0])
NAMES = {
    Mode.ZERO_TORQUE: "zero_torque_controller",
    Mode.DAMPING: "damping_controller",
    Mode.STANDBY: "standby_controller_a",
    Mode.LOCOMOTION: "rl_policy_controller",
    Mode.REMOTE: "remote_policy_controller",
}


def record(index, mode=Mode.DAMPING, *, effort=None, safety=(), duration=1e-4, overrun=False, **output):
    state = rig.state(index * 0.5, joint_effort=np.array(effort or [0.0, 0.0, 0.0]))
    control = ControlMode(mode, NAMES[mode], f"reason {index}")
    return TickRecord(
        index,
        TickInput(state, safety),
        replace(TickOutput(rig.command(), control), **output),
        duration,
        overrun,
        np.array([float(index)]),
    )


def monitored(*records):
    result = RunMonitor(JointUse(rig.JOINTS, LIMIT, -LIMIT, LIMIT))
    result.start(HEADER)
    for item in records:
        result.tick(item)
    result.close()
    assert result.error is None
    return result


def test_mode_spans():
    modes = [Mode.ZERO_TORQUE, Mode.DAMPING, Mode.DAMPING, Mode.STANDBY, Mode.DAMPING]
    spans = monitored(*(record(i, mode) for i, mode in enumerate(modes))).spans
    assert [(span.mode, span.start, span.end, span.reason) for span in spans] == [
        (Mode.ZERO_TORQUE, 0.0, 0.0, "reason 0"),
        (Mode.DAMPING, 0.5, 1.0, "reason 1"),
        (Mode.STANDBY, 1.5, 1.5, "reason 3"),
        (Mode.DAMPING, 2.0, 2.0, "reason 4"),
    ]


def test_faults_refusals_and_safety_with_their_times():
    fault = FaultReport("rl_policy_controller", "damping_controller", "action is nan")
    warning = SafetyStatus(SafetyLevel.WARNING, SafetyFlag.INVALID_FRAME, "can1")
    ok = SafetyStatus(source="can0")
    figures = monitored(
        record(0, safety=(ok,)),
        record(1, faults=(fault,)),
        record(2, refusals=("LOAD_A refused", "LOAD_B refused")),
        record(3, safety=(ok, warning)),
        record(4, safety=(ok, warning)),
        record(5, safety=(ok,)),
        record(6, safety=(ok, warning)),
    )
    assert list(figures.faults) == [(0.5, "rl_policy_controller: action is nan")]
    assert list(figures.refusals) == [(1.0, "LOAD_A refused"), (1.0, "LOAD_B refused")]
    text = "safety WARNING INVALID_FRAME from can1"
    assert list(figures.safety) == [(1.5, text), (3.0, text)]
