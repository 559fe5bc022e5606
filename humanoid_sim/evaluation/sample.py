"""What one policy step came to, for whoever judges or measures it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.reference import Alignment, Frame
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.simulation.floating_base import BaseState

__all__ = ["StepSample"]

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class StepSample:
    """One policy step: an action, and where it has brought the robot one `policy_dt` later."""

    state: MITState
    """At the end of the step, as it is: whatever delays or noise the policy sees it through."""
    action: Float32Array
    """Shape (..., m), raw: the one that was in force during the step."""
    previous_action: Float32Array
    """Shape (..., m), raw: the one before; zeros in the first step."""
    torque: FloatArray
    """Shape (..., n), N·m, saturated, of the step's last physics step."""
    frame: Frame
    """Shape (...), the reference frame that belongs to `state`: the next one to be shown, frame 1 after the first step
    and the last one again from the end of the motion on."""
    step: int | npt.NDArray[np.integer]
    """Shape (...), policy steps since the start, this one included: at least 1."""
    body_position: FloatArray
    """Shape (..., b, 3), m, base frame, of the contract's `body_names` at `state`; b is 0 where it names none."""
    body_quaternion: FloatArray
    """Shape (..., b, 4), w x y z, body frame in the base frame; of either sign."""
    command: FloatArray
    """Shape (..., 3), vx and vy in m/s and yaw rate in rad/s, heading frame: what was asked for during the step."""
    base: BaseState | None = None
    """Of robots with a floating base, at `state`; None for those with a fixed one."""
    alignment: Alignment | None = None
    """How the reference was laid onto the robot at the start."""
