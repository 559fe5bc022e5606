"""Looks of a model: colours for a robot that has only one, and how much of it a camera has to take in."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.piano import key_joint_names

_SAME = 0.08
"""Two colours that differ by less, in any channel, are one."""
_TRUNK = (0.72, 0.73, 0.76)
_LIMBS = ((0.93, 0.62, 0.32), (0.36, 0.60, 0.86), (0.55, 0.74, 0.42), (0.78, 0.52, 0.80))
"""One after the other for the limbs of a robot, each a chain of bodies that leaves the trunk."""
_ALTERNATE = 0.80
"""Brightness of every second body of a limb."""

_POSES = 50
"""By which the reach of a robot is found."""


def robot_geoms(model: mujoco.MjModel) -> list[int]:
    """Return the geoms that are drawn and belong to a tree of bodies with a joint in it: no floor, wall or table."""
    trees = {int(model.body_rootid[body]) for body in model.jnt_bodyid}
    shapeless = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    return [
        geom
        for geom in range(model.ngeom)
        if int(model.body_rootid[model.geom_bodyid[geom]]) in trees
        and model.geom_bodyid[geom] > 0
        and model.geom_type[geom] not in shapeless
        and model.geom_group[geom] < 3
    ]


def tint_limbs(model: mujoco.MjModel) -> bool:
    """Give the limbs of a robot that is all of one colour a colour each, and its bodies alternating ones.

    Without meshes and materials a robot is a heap of grey capsules in which nobody sees which leg is in front.
    Returns whether it was one; `model.geom_rgba` is written then.
    """
    geoms = robot_geoms(model)
    coloured = [geom for geom in geoms if model.geom_matid[geom] < 0 and model.geom_rgba[geom, 3] > 0.0]
    if len(coloured) < max(len(geoms), 2):
        return False
    if np.ptp(model.geom_rgba[coloured, :3], axis=0).max() > _SAME:
        return False
    limb, depth = _limbs(model)
    for geom in coloured:
        body = int(model.geom_bodyid[geom])
        colour = np.array(_TRUNK if limb[body] < 0 else _LIMBS[limb[body] % len(_LIMBS)])
        model.geom_rgba[geom, :3] = colour * (_ALTERNATE if depth[body] % 2 else 1.0)
    return True


def _limbs(model: mujoco.MjModel) -> tuple[list[int], list[int]]:
    """For each body, the number of its limb (-1: the trunk), and how many bodies with joints lie before it.

    The trunk is what has more than one moving chain below it, and what leads there.
    """
    children: list[list[int]] = [[] for _ in range(model.nbody)]
    for body in range(1, model.nbody):
        children[int(model.body_parentid[body])].append(body)
    joints = [0] * model.nbody
    for body in range(model.nbody - 1, 0, -1):  # children have larger numbers
        joints[body] = int(model.body_jntnum[body]) + sum(joints[child] for child in children[body])
    limb, depth, count = [-1] * model.nbody, [0] * model.nbody, 0
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        depth[body] = depth[parent] + bool(model.body_jntnum[body])
        if limb[parent] >= 0:
            limb[body] = limb[parent]
        elif parent > 0 and joints[body] and not _branches(children, joints, body):
            limb[body], count = count, count + 1
    return limb, depth


def _branches(children: list[list[int]], joints: list[int], body: int) -> bool:
    while True:
        moving = [child for child in children[body] if joints[child]]
        if len(moving) != 1:
            return len(moving) > 1
        body = moving[0]


def robot_box(model: mujoco.MjModel, *, moving: bool = False) -> tuple[FloatArray, FloatArray] | None:
    """Lower and upper corner (3,), m, world frame, of the robot in the model's reference pose; None without one.

    With `moving`, of all that it covers in poses within its joints' limits.
    """
    geoms = robot_geoms(model)
    if not geoms:
        return None
    data = mujoco.MjData(model)
    low, high = _box(model, data, geoms)
    if moving:
        rng = np.random.default_rng(0)
        scalar = np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
        limited = scalar & (model.jnt_limited > 0)
        addresses, limits = model.jnt_qposadr[limited], model.jnt_range[limited]
        for _ in range(_POSES):
            data.qpos[addresses] = rng.uniform(limits[:, 0], limits[:, 1])
            corners = _box(model, data, geoms)
            low, high = np.minimum(low, corners[0]), np.maximum(high, corners[1])
    return low, high


def keyboard_box(model: mujoco.MjModel) -> tuple[FloatArray, FloatArray] | None:
    """Middle and half extents (3,), m, world frame, of a piano's keys, released; None where there is none."""
    joints = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in key_joint_names()]
    if min(joints) < 0:
        return None
    geoms = np.flatnonzero(np.isin(model.geom_bodyid, model.jnt_bodyid[joints])).tolist()
    low, high = _box(model, mujoco.MjData(model), geoms)
    return 0.5 * (low + high), 0.5 * (high - low)


def _box(model: mujoco.MjModel, data: mujoco.MjData, geoms: list[int]) -> tuple[FloatArray, FloatArray]:
    mujoco.mj_kinematics(model, data)
    centre, half = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
    rotation = data.geom_xmat[geoms].reshape(-1, 3, 3)
    middle = data.geom_xpos[geoms] + np.einsum("gij,gj->gi", rotation, centre)
    reach = np.einsum("gij,gj->gi", np.abs(rotation), half)
    return (middle - reach).min(axis=0), (middle + reach).max(axis=0)
