"""A run of a robot that stumbles about its default pose; observation and action are this program's."""

import numpy as np

from humanoid_sim import mit
from humanoid_sim.controllers.policy_step import PolicyMemory, PolicyWiring, action_command
from humanoid_sim.policy.golden import with_memory
from humanoid_sim.policy.traces import EXTERN, Trace

STEPS = 64
"""Enough to fill any usual history."""


def made_up_run(checkpoint, motion=None):
    """All steps; heading and all else are not zero, so that nothing cancels."""
    contract, loaded = checkpoint.contract, checkpoint.following(motion)
    rng = np.random.default_rng(0)
    quaternion = np.array([0.5, 0.1, -0.1, 0.8]) + rng.normal(0.0, 0.05, (STEPS, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    ranges = np.array([[-1.0, 1.0]] * 3) if contract.command_ranges is None else contract.command_ranges
    live = {
        mit.VELOCITY_COMMAND: rng.uniform(ranges[:, 0], ranges[:, 1], (STEPS, 3)),
        mit.BASE_LINEAR_VELOCITY: rng.normal(0.0, 0.5, (STEPS, 3)),
        mit.ANCHOR_POSE: np.concatenate([rng.normal([1.0, 2.0, 0.8], 0.1, (STEPS, 3)), quaternion], axis=1),
    }
    live |= {mit.point_velocity(point): rng.normal(0.0, 0.5, (STEPS, 3)) for point in contract.velocity_points}
    if contract.height_scan is not None:
        live[mit.HEIGHT_SCAN] = rng.uniform(0.0, 1.0, (STEPS, contract.height_scan.count))
    if mit.KEY_PRESSED in loaded.extern:
        live[mit.KEY_PRESSED] = rng.integers(0, 2, (STEPS, loaded.extern[mit.KEY_PRESSED])).astype(float)
    joints = len(contract.joint_names)
    arrays = {
        "joint_position": contract.default_joint_pos + rng.normal(0.0, 0.2, (STEPS, joints)),
        "joint_velocity": rng.normal(0.0, 1.0, (STEPS, joints)),
        "imu_quaternion": quaternion,
        "imu_angular_velocity": rng.normal(0.0, 0.5, (STEPS, 3)),
        "imu_linear_acceleration": np.array([0.0, 0.0, 9.81]) + rng.normal(0.0, 1.0, (STEPS, 3)),
        "action": rng.normal(0.0, 0.5, (STEPS, contract.action_count)).astype(np.float32),
        **{EXTERN + name: values for name, values in live.items()},
    }
    run = with_memory(checkpoint, Trace("made-up states", contract.joint_names, arrays), motion)
    wiring = PolicyWiring(contract.joint_names, contract, loaded.reference, loaded.extern, action_limit=1e9)
    start = PolicyMemory(0, np.zeros(contract.action_count, dtype=np.float32))
    seen = np.stack([wiring.observe(run.memory(i, start), run.state(i))[0] for i in range(STEPS)])
    action = np.stack(
        [checkpoint.policy(row, int(frame)) for row, frame in zip(seen, run.arrays["frame"], strict=True)]
    )
    target = action_command(wiring.action_map, action).position
    answered = {"observation": seen, "action": action.astype(np.float32), "target": target}
    return Trace(run.name, run.joint_names, {**run.arrays, **answered}, run.frame_count)
