"""Ticks as front ends get them, without a session."""

from dataclasses import replace
from typing import Any

import numpy as np

from humanoid_sim.controllers.fsm import MODES
from humanoid_sim.messages import ControlMode, Mode, SafetyStatus, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState

_CONTROLLERS = {mode: name for name, mode in reversed(MODES.items())}


def record_of(
    state: MITState,
    mode: Mode = Mode.STANDBY,
    message: str = "",
    *statuses: SafetyStatus,
    index: int = 0,
    qpos: Any = None,
    **output: Any,
) -> TickRecord:
    """A tick in a mode whose command is zero."""
    control = ControlMode(mode, _CONTROLLERS[mode], message)
    decided = replace(TickOutput(MITCommand.zeros(state.joint_count), control), **output)
    pose = None if qpos is None else np.asarray(qpos, dtype=np.float64)
    return TickRecord(index, TickInput(state, statuses), decided, 0.001, False, pose)
