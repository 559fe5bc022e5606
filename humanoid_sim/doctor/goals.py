"""Goals of a policy in a trial (walk at a velocity, follow a motion, or at least not fall), and how well it meets them.

Nothing that is measured depends on the contract that is being tried: it is the robot in the world.
"""

from __future__ import annotations

import math

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import Alignment, MotionReference
from humanoid_sim.evaluation.errors import pose_error
from humanoid_sim.evaluation.failure import describe_fall, describe_stray, has_fallen, has_strayed
from humanoid_sim.evaluation.tracking import TrackingErrors
from humanoid_sim.mit import ANCHOR_POSE, FloatArray, MITCommand, MITState
from humanoid_sim.simulation.floating_base import BaseState

_SETTLED = 1.0
"""s until the velocity counts: the robot starts at rest."""
_VELOCITY, _TURNING, _TILT, _HEIGHT = 0.2, 0.5, 0.1, 0.02
"""m/s, rad/s, rad, and m of standard deviation, at which an onlooker begins to notice, as all below. Policies that are
wired right are about 0.1 m/s slower than commanded."""
_JOINTS, _POSITION, _ANGLE = 0.1, 0.3, 0.2
"""rad, mean over the joints; m and rad of the body that is compared."""
_HAND_POSITION, _HAND_ANGLE = 0.1, 0.3
"""m and rad, root mean squares."""
_SHAKING, _TORQUE = 5.0, 15.0
"""rad/s, root mean square of the commanded positions' change; N·m, root mean square."""


class Goal:
    """Judges a run step by step: of a free base, whether it falls. Subclasses know more."""

    def __init__(self) -> None:
        self._standing_height = 0.0

    def update(self, frame: int, state: MITState, base: BaseState | None) -> str:
        """Take in the state of one policy step; says how the robot was lost, or '' while it is not.

        `frame` is the reference's that the policy is shown in this step; `base` is None unless the robot stands free.
        """
        if base is None:
            return ""
        self._standing_height = self._standing_height or float(base.mass_height)
        return describe_fall(base, self._standing_height) if has_fallen(base, self._standing_height) else ""

    def parts(self) -> dict[str, float]:
        """Return the errors so far, as parts of the quality."""
        return {}


class VelocityGoal(Goal):
    """Walk at a commanded velocity without falling."""

    def __init__(self, command: FloatArray, policy_dt: float) -> None:
        super().__init__()
        self._command = command
        self._skip = round(_SETTLED / policy_dt)
        self._count = 0
        self._velocity = np.zeros(3)
        self._tilt = 0.0
        self._heights: list[float] = []

    def update(self, frame: int, state: MITState, base: BaseState | None) -> str:
        """See `Goal.update`."""
        assert base is not None
        self._count += 1
        self._tilt += float(base.tilt) ** 2
        if self._count > self._skip:
            self._velocity += base.planar_velocity
            self._heights.append(float(base.height))
        return super().update(frame, state, base)

    def parts(self) -> dict[str, float]:
        """See `Goal.parts`."""
        error = self._velocity / max(self._count - self._skip, 1) - self._command
        return {
            "velocity": math.hypot(error[0], error[1]) / _VELOCITY,
            "turning": abs(float(error[2])) / _TURNING,
            "tilt": math.sqrt(self._tilt / max(self._count, 1)) / _TILT,
            "height": float(np.std(self._heights)) / _HEIGHT if self._heights else 0.0,
        }


class MotionGoal(Goal):
    """Follow a motion with the joints and with one body, laid onto the robot as it stands at the start."""

    def __init__(
        self,
        contract: PolicyContract,
        reference: MotionReference,
        base: MotionReference | None,
        robot_joints: tuple[str, ...],
    ) -> None:
        """Look up the joints of the reference, which the contract orders, in the state's order, `robot_joints`.

        `base` has the base's poses as its anchor terms; None: the anchor body is compared, as the contract has it.
        """
        super().__init__()
        self._order = joint_indices(contract.joint_names, robot_joints, "joint_names of the policy")
        self._reference = reference
        self._base = base
        self._alignment: Alignment | None = None
        self._sums = np.zeros(3)
        self._count = 0

    def update(self, frame: int, state: MITState, base: BaseState | None) -> str:
        """See `Goal.update`."""
        self._count += 1
        target = self._reference.term("reference_joint_pos", frame)
        self._sums[0] += np.abs(state.joint_position[self._order] - target).mean()
        pose = self._pose(state, base)
        if pose is None:
            return ""
        poses = self._base or self._reference
        if self._alignment is None:
            self._alignment = poses.align(pose)
        error = pose_error(pose, *poses.anchor(frame, self._alignment))
        self._sums[1:] += (error.distance, error.angle)
        return describe_stray(error) if has_strayed(error) else ""

    def _pose(self, state: MITState, base: BaseState | None) -> FloatArray | None:
        """Shape (7,), of the body that is compared; None if there is nothing to compare it with."""
        if self._base is not None and base is not None:
            return np.concatenate([base.position, base.quaternion])
        live = state.extern.get(ANCHOR_POSE)
        return live.value if live is not None and "anchor_pos" in self._reference.terms else None

    def parts(self) -> dict[str, float]:
        """See `Goal.parts`."""
        joints, position, angle = (float(mean) for mean in self._sums / max(self._count, 1))
        return {"joints": joints / _JOINTS, "position": position / _POSITION, "angle": angle / _ANGLE}


class BodiesGoal(Goal):
    """Follow the bodies of a motion that is given in the base's frame."""

    def __init__(self, errors: TrackingErrors) -> None:
        super().__init__()
        self._errors = errors

    def update(self, frame: int, state: MITState, base: BaseState | None) -> str:
        """See `Goal.update`."""
        self._errors.update(frame, state.joint_position)
        return super().update(frame, state, base)

    def parts(self) -> dict[str, float]:
        """See `Goal.parts`."""
        hands = self._errors.summary().hands
        return {"position": hands.position_rms / _HAND_POSITION, "angle": hands.orientation_rms / _HAND_ANGLE}


class Strain:
    """Strain on the joints: a wrong wiring that stays up shakes and strains them."""

    def __init__(self, policy_dt: float) -> None:
        self._period = policy_dt
        self._last: FloatArray | None = None
        self._change = 0.0
        self._torque = 0.0
        self._count = 0

    def update(self, state: MITState, command: MITCommand) -> None:
        """Take in one policy step."""
        if self._last is not None:
            self._change += float(((command.position - self._last) ** 2).mean())
        self._torque += float((state.joint_effort**2).mean())
        self._last = command.position
        self._count += 1

    def parts(self) -> dict[str, float]:
        """As parts of the quality."""
        count = max(self._count, 1)
        return {
            "shaking": math.sqrt(self._change / count) / self._period / _SHAKING,
            "torque": math.sqrt(self._torque / count) / _TORQUE,
        }
