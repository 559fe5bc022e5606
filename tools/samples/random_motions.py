"""Random motions to train on, and, from other seeds, to test on: none of the sample motions is among them.

Three families: way points through a smoothing window, sums of sines in joint space, and random twists of the hand.
They cover the workspace that is free of collisions, at hand speeds up to 1.4 m/s, within limits and effort limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import mujoco
import numpy as np

from humanoid_sim.evaluation.tracking import peak_speed
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import build_model, joint_addresses
from tools.samples.arm import ARM_JOINTS, ArmModel, both_arms
from tools.samples.motions import BODIES, POLICY_DT, derivative, ease, joint_frames, smooth

__all__ = ["PERIOD", "collisions", "held_out_motions", "random_motions"]

PERIOD = 0.01
"""s between samples: half a policy step, so that a step's middle is a sample too."""

_FASTEST_JOINT = 8.0
"""rad/s"""
_EFFORT_SHARE = 0.7
"""Share of the effort limit that following the motion may take. The rest is for correcting."""
_LIMIT_ROOM = 0.005
"""rad"""
_LEAST_SPEED = 0.5
"""m/s that one of the hands reaches."""
_HELD_OUT = 77
"""Keeps evaluation apart from training, whatever the seed."""


def random_motions(arm: ArmModel, rng: np.random.Generator, duration: float = 8.0) -> Iterator[FloatArray]:
    """Motions of one arm without end, each of shape (F, 7), rad, one row per `PERIOD`."""
    families = (_waypoints, _sines, _twists)
    while True:
        family = families[rng.choice(3, p=[0.45, 0.35, 0.2])]
        path = family(arm, rng, round(duration / PERIOD))
        if _is_within_limits(arm, path):
            path = _at_speed(arm, path, rng.uniform(0.3, 1.4) if rng.random() < 0.9 else 0.05)
            if _is_feasible(arm, path):
                yield path


def _start(arm: ArmModel, rng: np.random.Generator) -> FloatArray:
    return arm.home if rng.random() < 0.6 else arm.sample(rng)


def _waypoints(arm: ArmModel, rng: np.random.Generator, count: int) -> FloatArray:
    """From one random pose to the next, sometimes with a pause; the window decides how round the corners are."""
    here = _start(arm, rng)
    reach, pause = rng.uniform(0.25, 1.0), rng.uniform(0.0, 1.2)
    rows = [here] * round(rng.uniform(0.1, 0.6) / PERIOD)
    while len(rows) < count:
        there = here + reach * (arm.sample(rng) - here)
        seconds = max(0.25, np.abs(there - here).max() / rng.uniform(1.0, 4.0))
        rows += list(here + np.linspace(0.0, 1.0, round(seconds / PERIOD))[:, None] * (there - here))
        if rng.random() < 0.4:
            rows += [there] * round(pause * rng.random() / PERIOD)
        here = there
    return smooth(np.array(rows[:count]), round(rng.uniform(0.25, 0.7) / PERIOD))


def _sines(arm: ArmModel, rng: np.random.Generator, count: int) -> FloatArray:
    """Up to three sines per joint around a random pose, in some or all of the joints; half of them from rest."""
    t = np.arange(count)[:, None] * PERIOD
    centre = arm.sample(rng) if rng.random() < 0.5 else _clip(arm, arm.home + rng.normal(0.0, 0.2, ARM_JOINTS))
    is_moving = rng.random(ARM_JOINTS) < rng.choice([0.3, 0.6, 1.0])
    is_moving[rng.integers(ARM_JOINTS)] = True
    path = np.zeros((count, ARM_JOINTS))
    for _ in range(rng.integers(1, 4)):
        frequency = rng.uniform(0.1, 1.3, ARM_JOINTS) if rng.random() < 0.5 else rng.uniform(0.2, 1.2)
        amplitude = np.where(is_moving, rng.normal(0.0, 0.35, ARM_JOINTS), 0.0)
        path += amplitude * np.sin(2.0 * np.pi * (frequency * t + rng.random(ARM_JOINTS)))
    room = np.minimum(centre - arm.lower, arm.upper - centre) - 4.0 * _LIMIT_ROOM
    path = centre + path * np.minimum(1.0, room / np.maximum(np.abs(path).max(axis=0), 1e-9))
    if rng.random() < 0.5:
        first = arm.home if rng.random() < 0.7 else centre
        path = first + ease(t / rng.uniform(0.6, 1.5)) * (path - first)
    return np.asarray(path, dtype=np.float64)


def _twists(arm: ArmModel, rng: np.random.Generator, count: int) -> FloatArray:
    """Return the hand moves along sines in Cartesian space, with or without turning: lines, ellipses, loops."""
    home = q = _start(arm, rng)
    frequency = rng.uniform(0.2, 1.1, 6) if rng.random() < 0.6 else np.full(6, rng.uniform(0.2, 1.1))
    phase = rng.random(6)
    turning = 1.0 if rng.random() < 0.6 else 0.0
    amplitude = rng.normal(0.0, 1.0, 6) * np.array([0.5, 0.5, 0.5, turning, turning, turning])
    rows = [q]
    for t in np.arange(count - 1) * PERIOD:
        twist = amplitude * np.cos(2.0 * np.pi * (frequency * t + phase)) * ease(t / 0.8)
        jacobian = arm.jacobians(q[None])[0, 1]
        normal = jacobian @ jacobian.T + 0.02 * np.eye(6)
        pull = 0.3 * (home - q)  # in the null space: the elbow comes back
        q = q + PERIOD * (pull + jacobian.T @ np.linalg.solve(normal, twist - jacobian @ pull))
        rows.append(q)
    return np.array(rows)


def _clip(arm: ArmModel, q: FloatArray) -> FloatArray:
    return np.clip(q, arm.lower + 10.0 * _LIMIT_ROOM, arm.upper - 10.0 * _LIMIT_ROOM)


def _is_within_limits(arm: ArmModel, path: FloatArray) -> bool:
    return bool((path > arm.lower + _LIMIT_ROOM).all() and (path < arm.upper - _LIMIT_ROOM).all())


def _at_speed(arm: ArmModel, path: FloatArray, speed: float) -> FloatArray:
    """Return the path at another pace, so that the hand peaks at `speed` (m/s); it stops where the path ends."""
    every = 10
    linear = arm.jacobians(path[::every])[:, 1, :3]
    hand = np.einsum("fij,fj->fi", linear, derivative(path, PERIOD)[::every])
    fastest = np.sqrt((hand * hand).sum(axis=1)).max()
    pace = min(speed / max(fastest, 1e-3), 2.5)
    samples = np.arange(len(path))
    warped = np.minimum(samples * pace, len(path) - 1)
    return smooth(np.stack([np.interp(warped, samples, column) for column in path.T], axis=-1), 9)


def _is_feasible(arm: ArmModel, path: FloatArray) -> bool:
    """Not too fast for the motors, not too strong, and free of collisions but for a moment."""
    velocity = derivative(path, PERIOD)
    if np.abs(velocity).max() > _FASTEST_JOINT:
        return False
    acceleration = derivative(velocity, PERIOD)
    every = 5
    mass, bias = arm.dynamics(path[::every], velocity[::every])
    torque = np.einsum("fij,fj->fi", mass, acceleration[::every]) + bias
    if (np.abs(torque) > _EFFORT_SHARE * arm.effort_limit).any():
        return False
    touching = [arm.collides(q) for q in path[::20]]
    return float(np.mean(touching)) <= 0.1


def held_out_motions(description: RobotDescription, count: int, seed: int) -> list[Motion]:
    """`count` random motions of both arms from pose A, at rest there, without collisions."""
    arm = ArmModel(description)
    rng = np.random.default_rng([_HELD_OUT, seed])
    paths = (path[::2] for path in random_motions(arm, rng) if np.abs(path[:3] - arm.home).max() < 1e-3)

    def motions() -> Iterator[Motion]:
        while True:
            path = both_arms(next(paths), next(paths))
            frames = joint_frames(description, path)
            hands = frames[:, : 3 * len(BODIES)].reshape(len(frames), len(BODIES), 3)
            if peak_speed(hands[:, 1::2], POLICY_DT) >= _LEAST_SPEED and not collisions(description, path[::5]):
                yield Motion(frames, BODIES, POLICY_DT, "tracking", description.name)

    return list(islice(motions(), count))


def collisions(description: RobotDescription, path: FloatArray) -> set[tuple[str, str]]:
    """Names of the bodies that touch anywhere on a joint path (F, n), rad."""
    model = build_model(description, scene=False)
    data = mujoco.MjData(model)
    qpos = joint_addresses(model, description.joint_names).qpos
    touching = set()
    for q in path:
        data.qpos[qpos] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for a, b in model.geom_bodyid[data.contact.geom]:
            touching.add((model.body(a).name, model.body(b).name))
    return touching
