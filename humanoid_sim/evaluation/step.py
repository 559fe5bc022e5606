"""One policy step of a robot or a batch, and what it is judged by: robot, contract and motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import Alignment, Frame, MotionReference
from humanoid_sim.controllers.rotation import quaternion_from_matrix, rotation_from_6d
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.feet import Feet, find_feet
from humanoid_sim.mit import BoolArray, Float32Array, FloatArray, MITState
from humanoid_sim.robots.piano import KEY_COUNT, is_white, key_joint_names
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation.floating_base import BaseState
from humanoid_sim.simulation.model import base_body, build_model

_FROM_EDGE = {True: 0.012, False: 0.010}  # m from the front edge at which white keys, and black ones, are struck


@dataclass(frozen=True, slots=True, eq=False)
class StepSample:
    """One policy step: an action, and the state that it led to one `policy_dt` later, without delays."""

    state: MITState
    frame: Frame
    """Shape (...), the reference frame that belongs to `state`: 1 after the first step; the last one is held."""
    action: Float32Array = field(default_factory=lambda: np.zeros(0, dtype=np.float32))
    """Shape (..., m), raw: the one that was in force during the step."""
    previous_action: Float32Array = field(default_factory=lambda: np.zeros(0, dtype=np.float32))
    """Shape (..., m), raw: the one before; zeros in the first step."""
    torque: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Shape (..., n), N·m, saturated, of the last physics step."""
    step: int | npt.NDArray[np.integer] = 0
    """Shape (...), policy steps since the start, this one included."""
    body_position: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Shape (..., b, 3), m, base frame, of `StepContext.bodies`."""
    body_quaternion: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    """Shape (..., b, 4), w x y z, body frame in the base frame; of either sign."""
    command: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Shape (..., 3), vx and vy in m/s and yaw rate in rad/s, heading frame: the command during the step."""
    base: BaseState | None = None
    """State of a floating base; None for a fixed one."""
    alignment: Alignment | None = None
    """Alignment of the reference with the robot at the start."""
    phase: FloatArray | None = None
    """Shape (..., k), rad: the gait phase observed at `state`; NaN while the robot stands. None without one."""
    shared: dict[str, FloatArray] = field(default_factory=dict, init=False)
    """Intermediate values that several metrics need, by name."""


class StepContext:
    """Robot, contract and motion of a sample."""

    def __init__(
        self,
        description: RobotDescription,
        contract: PolicyContract,
        reference: MotionReference,
        *,
        standing_height: float = 0.0,
        joint_target: FloatArray | None = None,
    ) -> None:
        """Prepare for a robot.

        Args:
            standing_height: m, of the centre of mass above the floor where the robot stands; 0 for a fixed base.
            joint_target: shape (F, n), rad, robot's order, by frame; None: the reference's joints.
        """
        self.description, self.contract, self.reference = description, contract, reference
        self.standing_height = standing_height
        self.lower, self.upper = np.array(description.lower), np.array(description.upper)
        self.inverse_effort = 1.0 / np.array(description.effort_limit)
        order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
        self.default_pose = np.clip(contract.default_joint_pos[order], self.lower, self.upper)
        """Shape (n,), rad, robot's order, within the limits."""
        terms = reference.terms
        if joint_target is None and "reference_joint_pos" in terms:
            joint_target = terms["reference_joint_pos"][:, order].astype(np.float64)
        self.joint_target = joint_target
        self.tracked = contract.body_names if "motion_body_pos_b" in terms else ()
        """Bodies that the motion has in the base frame."""
        hands = [i for i, name in enumerate(self.tracked) if name in description.hands]
        self.hands = hands or list(range(len(self.tracked)))
        """Indices of the tracked bodies that are hands; all of them if none is."""
        self.bodies = self.tracked
        """Bodies whose poses a sample has: the tracked ones, then feet or wrists if `require` asked for them."""
        self.moving_sites: tuple[str, ...] = ()
        """Sites whose velocity the state has to report."""

    def has(self, needs: str) -> bool:
        """Return whether this robot, contract and motion have what a metric needs."""
        terms, robot = self.reference.terms, self.description
        has_anchor = "anchor_pos" in terms and bool(self.contract.anchor_body)
        if needs == "gait":  # finding feet builds a model
            return self.contract.phase is not None and robot.is_floating and len(self.feet.bodies) == 2
        has = {
            "motion": bool(self.tracked) or has_anchor,
            "motion with joints": self.joint_target is not None,
            "motion with an anchor": has_anchor,
            "floating base": robot.is_floating,
            "song": robot.piano is not None and "target_keys" in terms,
        }
        return has.get(needs, True)

    def require(self, metric: str, needs: str) -> None:
        """Prepare for a metric. Raises `InputError` if this robot, contract or motion does not have what it needs."""
        if not self.has(needs):
            robot = self.description.name
            raise InputError(f"{metric}: needs a {needs}, which robot '{robot}' with this policy does not have")
        if needs == "gait":
            self.moving_sites = self.feet.bodies
        if needs in ("gait", "song"):
            self.bodies = (*self.tracked, *(self.feet.bodies if needs == "gait" else self.fingers[0]))

    @cached_property
    def body_target(self) -> tuple[FloatArray, FloatArray]:
        """Positions (F, b, 3), m, and quaternions (F, b, 4) of the tracked bodies in the base frame."""
        count, terms = len(self.tracked), self.reference.terms
        columns = terms["motion_body_ori_b"].astype(np.float64).reshape(-1, count, 6)
        position = terms["motion_body_pos_b"].astype(np.float64).reshape(-1, count, 3)
        return position, quaternion_from_matrix(rotation_from_6d(columns))

    @cached_property
    def feet(self) -> Feet:
        """Return the robot's feet."""
        return find_feet(self.description)

    @cached_property
    def steady_joints(self) -> FloatArray:
        """Shape (n,), 1 for joints that neither step nor bend: yaw and roll."""
        return np.array([float("yaw" in name or "roll" in name) for name in self.description.joint_names])

    @cached_property
    def song(self) -> BoolArray:
        """Shape (F, 88), the keys to hold down."""
        return np.asarray(self.reference.terms["target_keys"] > 0.5)

    @cached_property
    def fingers(self) -> tuple[tuple[str, ...], FloatArray]:
        """Return the wrists' bodies, and the fingertips in their frames, shape (2, 3), m."""
        assert self.description.piano is not None
        model = build_model(self.description, scene=False)
        sites = [model.site(name).id for name in self.description.piano.fingers]
        return tuple(model.body(wrist).name for wrist in model.site_bodyid[sites]), model.site_pos[sites].copy()

    @cached_property
    def strike_points(self) -> FloatArray:
        """Shape (88, 3), m, base frame: where released keys are struck."""
        model = build_model(self.description, scene=False)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        bodies = [int(model.joint(name).bodyid[0]) for name in key_joint_names()]
        struck: FloatArray = model.geom_size[model.body_geomadr[bodies]] * (1.0, 0.0, 1.0)  # middle of the front edge
        struck[:, 0] -= [_FROM_EDGE[is_white(key)] for key in range(KEY_COUNT)]
        base = base_body(model, self.description)
        rotation = data.xmat[bodies].reshape(-1, 3, 3)
        world = data.xpos[bodies] + np.einsum("kij,kj->ki", rotation, struck) - data.xpos[base]
        points: FloatArray = world @ data.xmat[base].reshape(3, 3)
        return points
