"""A robot's two fingers over a piano: where keys are struck, the poses that strike them, and which can be reached."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray, IndexArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT, PIANOS, Key
from humanoid_sim.simulation.kinematics import damped_step
from humanoid_sim.simulation.model import base_body, bodies_above, build_model, joint_addresses

HANDS = ("left", "right")
"""In the order of `PianoSettings.fingers`."""
HOVER = 0.016
"""m between a finger and the key below it, before it strikes."""
LIFT = 0.05
"""m above the white keys at which a finger goes from one key to another: well above the black ones."""
DEPTH = 0.86
"""Share of its travel to which a key is pressed."""
_FROM_EDGE = {True: 0.012, False: 0.010}
"""m from the front edge at which white keys are struck, and black ones: over white keys is then only the tip."""
_DIRECTION = np.array([0.6, 0.0, -0.8])
"""World frame, from the wrist to the tip: steep, so that a finger touches no neighbour of its key."""
_TURN, _DRIFT = 0.2, 0.06
"""Strengths of the pulls to that direction and back to the ready pose, as far as they leave the tip in place."""
_DAMPING = 0.01
"""m/rad"""
_ITERATIONS = 100
_CONVERGED = 1e-4
"""rad"""
_MISS = 1e-3
"""m by which a tip may miss."""
_STEEP = 0.4
"""Least share of the finger's length that points down."""
_STOP_MARGIN = 0.03
"""rad that joints keep from their limits."""
_OVERLAP = 5e-4
"""m by which shapes may overlap."""


@dataclass(frozen=True, slots=True, eq=False)
class Strike:
    """The poses, shape (7,), rad each, in which an arm plays a key."""

    lifted: FloatArray
    """On the way to other keys."""
    above: FloatArray
    touched: FloatArray
    pressed: FloatArray


class Fingers:
    """The poses in which each hand strikes each key. Keeps one model and its buffers; one instance per thread.

    A pose is a function of where the tip is, whatever was before: from the ready pose, the last one of
    `standby_controller_a`, the arm goes to the nearest pose in which the finger points down as far as it can.
    """

    def __init__(self, description: RobotDescription) -> None:
        """Build the model. Raises `InputError` for a robot without a piano."""
        if description.piano is None:
            raise InputError(f"{description.name}: has no piano, expected a robot with one, such as lite_piano")
        self.description = description
        self.settings = description.piano
        self.keys = PIANOS[self.settings.figures].keys
        self._model = model = build_model(description, scene=False)
        self._data = mujoco.MjData(model)
        self._joints = joint_addresses(model, description.joint_names)
        self._key_qpos = joint_addresses(model, tuple(key.joint for key in self.keys)).qpos
        self.ready: FloatArray = np.array(description.standby_controller_a.pose_segments[-1])
        """Shape (n,), rad: both hands over the keys."""
        self._sites = [model.site(name).id for name in self.settings.fingers]
        self._wrists = [int(model.site_bodyid[site]) for site in self._sites]
        self.arms = tuple(self._arm(wrist) for wrist in self._wrists)
        """Indices of each hand's joints in the robot's order."""
        mujoco.mj_kinematics(model, self._data)
        piano = model.body("piano").id
        self._origin = self._data.xpos[piano].copy()
        self._axes = self._data.xmat[piano].reshape(3, 3).copy()
        self._jacobians = np.empty((3, model.nv)), np.empty((3, model.nv))

    @property
    def wrists(self) -> tuple[str, ...]:
        """The bodies that the fingers are rigid parts of."""
        return tuple(self._model.body(wrist).name for wrist in self._wrists)

    @property
    def tips(self) -> FloatArray:
        """Shape (2, 3), m, frames of the wrists: the middles of the round tips."""
        tips: FloatArray = self._model.site_pos[self._sites].copy()
        return tips

    @property
    def strike_points(self) -> FloatArray:
        """Shape (88, 3), m, frame of the robot's base: where keys that are released are struck."""
        mujoco.mj_kinematics(self._model, self._data)
        base = base_body(self._model, self.description)
        world = np.stack([self.strike_point(key) for key in self.keys]) - self._data.xpos[base]
        points: FloatArray = world @ self._data.xmat[base].reshape(3, 3)
        return points

    def _arm(self, body: int) -> IndexArray:
        owners = self._model.dof_bodyid[self._joints.dof]
        return np.flatnonzero(np.isin(owners, bodies_above(self._model, body)))

    def strike_point(self, key: Key, pressed: float = 0.0) -> FloatArray:
        """Return where on a key's surface its finger strikes, pressed by a share of its travel: (3,), m, world."""
        x = key.box.position[0] + key.box.size[0] - _FROM_EDGE[key.is_white]
        drop = (x - key.hinge) * math.tan(pressed * key.upper)
        place: FloatArray = self._origin + self._axes @ [x, key.box.position[1], key.top - drop]
        return place

    def tip_above(self, key: Key, height: float, pressed: float = 0.0) -> FloatArray:
        """Give where the middle of the round tip is, `height` m above the key's surface: shape (3,), m, world frame."""
        tip = self.strike_point(key, pressed)
        tip[2] += self.settings.finger_radius + height
        return tip

    def tip_lifted(self, key: Key) -> FloatArray:
        """Give where the tip is on the way to other keys: shape (3,), m, world frame. A straight line over all keys."""
        ends = [key.box.position[0] + key.box.size[0] - _FROM_EDGE[key.is_white] for key in self.keys[:2]]
        height = LIFT + self.settings.finger_radius
        place: FloatArray = self._origin + self._axes @ [0.5 * sum(ends), key.box.position[1], height]
        return place

    def solve(self, hand: int, tip: FloatArray, start: FloatArray | None = None) -> FloatArray:
        """Return the arm's pose, shape (7,), rad, that brings the middle of the tip as near to a place as it gets.

        Args:
            tip: shape (3,), m, world frame.
            start: shape (7,), rad, of the same arm, to begin near the solution; None for the ready pose.
        """
        arm = self.arms[hand]
        ready = self.ready[arm]
        lower, upper = self.description.lower[arm], self.description.upper[arm]
        q = ready.copy() if start is None else start.copy()
        position, rotation = self._jacobians
        dof = self._joints.dof[arm]
        for _ in range(_ITERATIONS):
            place, direction = self.place(hand, q)
            mujoco.mj_jacSite(self._model, self._data, position, rotation, self._sites[hand])
            pull = _TURN * rotation[:, dof].T @ _cross(direction, _DIRECTION) + _DRIFT * (ready - q)
            step = damped_step(position[:, dof], tip - place, _DAMPING, pull)
            before = q
            q = np.clip(q + step, lower, upper)
            if np.abs(q - before).max() < _CONVERGED:
                break
        return q

    def place(self, hand: int, arm_position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the middle of the tip, m, and the finger's direction, both (3,), world, in an arm's pose (7,), rad."""
        data = self._data
        data.qpos[self._joints.qpos[self.arms[hand]]] = arm_position
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        tip: FloatArray = data.site_xpos[self._sites[hand]].copy()
        along = tip - data.xpos[self._wrists[hand]]
        return tip, along / np.sqrt((along * along).sum())

    def holding_torque(self, hand: int, arm_position: FloatArray, force: float) -> FloatArray:
        """Shape (7,), N·m: what holds the arm in a pose while its tip presses down with `force` N."""
        data, model = self._data, self._model
        self.place(hand, arm_position)
        bias = np.empty(model.nv)
        data.qvel[:] = 0.0
        mujoco.mj_rne(model, data, 0, bias)
        mujoco.mj_jacSite(model, data, self._jacobians[0], None, self._sites[hand])
        dof = self._joints.dof[self.arms[hand]]
        torque: FloatArray = bias[dof] - force * self._jacobians[0][2, dof]
        return torque

    def spring_force(self, key: Key, pressed: float = 1.0) -> float:
        """N at the strike point that hold a key at a share of its travel; its weight, which helps, is left out."""
        figures = PIANOS[self.settings.figures]
        x = key.box.position[0] + key.box.size[0] - _FROM_EDGE[key.is_white]
        return figures.stiffness * (pressed * key.upper - figures.spring_reference) / (x - key.hinge)

    def strike(self, hand: int, key: Key) -> Strike | None:
        """Return how a hand plays a key.

        None where it cannot reach it, touches anything else, or comes close to a joint's limit.
        """
        lifted_tip = self.tip_lifted(key)
        above_tip, pressed_tip = self.tip_above(key, HOVER), self.tip_above(key, 0.0, DEPTH)
        lifted = self.solve(hand, lifted_tip)
        above = self.solve(hand, above_tip, lifted)
        touched = self.solve(hand, self.tip_above(key, 0.0), above)
        pressed = self.solve(hand, pressed_tip, touched)
        for pose, tip, share in ((lifted, lifted_tip, 0.0), (above, above_tip, 0.0), (pressed, pressed_tip, DEPTH)):
            if not self._is_clean(hand, pose, tip, key, share):
                return None
        return Strike(lifted, above, touched, pressed)

    def reachable(self, hand: int, keys: Collection[int] = range(KEY_COUNT)) -> Mapping[int, Strike]:
        """Return those of some keys that a hand can strike, and how: the longest run without a gap."""
        longest: dict[int, Strike] = {}
        run: dict[int, Strike] = {}
        for key in self.keys:
            strike = self.strike(hand, key) if key.index in keys else None
            run = {} if strike is None else {**run, key.index: strike}
            longest = run if len(run) > len(longest) else longest
        return longest

    def _is_clean(self, hand: int, pose: FloatArray, tip: FloatArray, key: Key, share: float) -> bool:
        arm = self.arms[hand]
        place, direction = self.place(hand, pose)
        lower, upper = self.description.lower[arm], self.description.upper[arm]
        inside = np.minimum(pose - lower, upper - pose).min() >= _STOP_MARGIN
        is_there = np.abs(place - tip).max() < _MISS and -direction[2] >= _STEEP
        return bool(inside and is_there and not self.touched(hand, pose, key, share))

    def touched(self, hand: int, pose: FloatArray, key: Key, share: float = 0.0) -> list[str]:
        """Return what an arm in a pose overlaps with, beside the finger with its key, pressed by a share of its travel.

        The other arm is in its ready pose.
        """
        model, data = self._model, self._data
        data.qpos[self._joints.qpos] = self.ready
        data.qpos[self._joints.qpos[self.arms[hand]]] = pose
        data.qpos[self._key_qpos] = 0.0
        data.qpos[self._key_qpos[key.index]] = share * key.upper
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        data.qpos[self._key_qpos] = 0.0
        own = {self._wrists[hand], model.body(key.name).id}
        pairs = model.geom_bodyid[data.contact.geom[data.contact.dist < -_OVERLAP]].tolist() if data.ncon else []
        return [f"{model.body(a).name} and {model.body(b).name}" for a, b in pairs if {a, b} != own]


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """As `numpy.cross`, of which a single product takes as long as all else in an iteration."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
