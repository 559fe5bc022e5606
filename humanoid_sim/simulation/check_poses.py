"""Safety of check poses: they must do no harm even with the very fault that they are meant to show."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription, check_poses
from humanoid_sim.simulation.model import build_model, joint_addresses

__all__ = ["check_pose_problems"]

OFFSET = 0.4
"""rad: the homing offset that a joint may have in a check pose without harm."""
_MOVED = 1e-3
"""rad from where STANDBY leaves a joint."""
_SHARES = (0.25, 0.5, 0.75, 1.0)
"""Shares of the way from one pose to the next at which contacts are looked for."""
_TOUCHING = -1e-3
"""m, distance below which two surfaces touch."""


def check_pose_problems(description: RobotDescription) -> Iterator[str]:
    """Yield what is wrong with the check poses of a robot, as `check_poses[0]: what is wrong`.

    With any one joint mirrored, or off by `OFFSET` either way, each joint that a pose moves stays within its limits,
    and no parts of the robot touch, on the way either, that do not touch in STANDBY with the same fault. A joint that
    stays where STANDBY has it may press its stop as it does in STANDBY.
    """
    touching = _Touching(description)
    lower, upper = description.lower, description.upper
    for standby in dict.fromkeys(
        settings.pose_segments[-1] for settings in (description.standby_controller_a, description.standby_controller_b)
    ):
        start = np.array(standby)
        before = {fault: touching(_true_pose(start, *fault, description)) for fault in _faults(len(start))}
        poses = [np.array(pose) for pose in (*check_poses(description, standby), standby)]
        for i, (pose, earlier) in enumerate(zip(poses, [start, *poses[:-1]], strict=True)):
            where = f"check_poses[{i}]" if i < len(poses) - 1 else "check_poses, on the way back"
            for joint, sign, offset in _faults(len(pose)):
                true = sign * pose[joint] + offset
                if abs(pose[joint] - start[joint]) > _MOVED and not lower[joint] <= true <= upper[joint]:
                    yield (
                        f"{where}: {description.joint_names[joint]} would be at {true:.2f} rad "
                        f"{_named(sign, offset)}, beyond its limits, {lower[joint]:g} to {upper[joint]:g}"
                    )
                for share in _SHARES:
                    place = _true_pose(earlier + share * (pose - earlier), joint, sign, offset, description)
                    new = touching(place) - before[joint, sign, offset]
                    if new:
                        parts = " and ".join(sorted(new)[0])
                        fault = f"{description.joint_names[joint]} {_named(sign, offset)}"
                        yield f"{where}: {parts} touch, or did so on the way there, with {fault}"
                        break


def _faults(count: int) -> list[tuple[int, float, float]]:
    """Joint, sign and offset, rad, of each fault."""
    kinds = ((-1.0, 0.0), (1.0, OFFSET), (1.0, -OFFSET))
    return [(joint, *kind) for joint in range(count) for kind in kinds]


def _named(sign: float, offset: float) -> str:
    return "mirrored" if sign < 0.0 else f"off by {offset:+g} rad"


def _true_pose(pose: FloatArray, joint: int, sign: float, offset: float, description: RobotDescription) -> FloatArray:
    place = pose.copy()
    true = sign * pose[joint] + offset
    place[joint] = min(max(true, description.lower[joint]), description.upper[joint])
    return place


class _Touching:
    """Pairs of a robot's parts that touch each other in a pose."""

    def __init__(self, description: RobotDescription) -> None:
        model = build_model(description, scene=False)
        self._model, self._data = model, mujoco.MjData(model)
        self._qpos = joint_addresses(model, description.joint_names).qpos
        self._is_robot = model.body_weldid != 0
        if not description.is_floating:  # the chest, but no floor
            self._is_robot = self._is_robot | (model.body_rootid != 0)

    def __call__(self, pose: FloatArray) -> frozenset[tuple[str, str]]:
        """Return the pairs, by the names of their bodies, in a pose of shape (n,), rad."""
        model, data = self._model, self._data
        data.qpos[self._qpos] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        found = set()
        for contact in range(data.ncon):
            bodies = model.geom_bodyid[data.contact.geom[contact]]
            if data.contact.dist[contact] < _TOUCHING and self._is_robot[bodies].all():
                first, second = sorted(model.body(int(body)).name for body in bodies)
                found.add((first, second))
        return frozenset(found)
