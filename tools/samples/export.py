"""The trained network as an ONNX file that describes itself.

The graph is written out by hand, operator by operator: it is small, it needs no exporter of PyTorch's, and its node
names can be read in any viewer. `train` checks it against the network it was made from.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnx

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.robots.description import RobotDescription
from tools.samples import scales
from tools.samples.arm import ARM_JOINTS, JOINT_SIGN, ORIENTATION_SIGN, POSITION_SIGN
from tools.samples.graph import SampleGraph, write_model
from tools.samples.motions import BODIES, POLICY_DT, SAMPLE_DATASET, pose_a

__all__ = ["OBSERVATIONS", "export_policy", "policy_graph", "sample_contract"]

OBSERVATIONS = ("motion_body_pos_b", "motion_body_ori_b", "joint_pos", "joint_vel", "actions")


def sample_contract(description: RobotDescription) -> PolicyContract:
    """Return the contract of the sample policy on a robot with two of the Lite's arms."""
    joints = description.joint_names
    return PolicyContract(
        task_type="tracking",
        joint_names=joints,
        action_joint_names=joints,
        joint_stiffness=description.stiffness,
        joint_damping=description.damping,
        default_joint_pos=pose_a(description),
        observation=OBSERVATIONS,
        command_names=("motion",),
        action_scale=np.full(len(joints), scales.ACTION),
        policy_dt=POLICY_DT,
        body_names=BODIES,
        dataset_repo_id=SAMPLE_DATASET,
    )


def export_policy(
    path: Path, weights: Mapping[str, npt.NDArray[np.float32]], origin: FloatArray, contract: PolicyContract
) -> None:
    """Write the policy with its metadata; an existing file is replaced only by a whole one.

    Raises `InputError` if the file cannot be written.

    Args:
        path: of the .onnx file.
        weights: of an `ArmNetwork`, by the names of its parameters.
        origin: shape (3,), m, base frame: the left shoulder.
        contract: becomes the metadata.
    """
    write_model(path, policy_graph(weights, origin), write_metadata(contract))


def policy_graph(weights: Mapping[str, npt.NDArray[np.float32]], origin: FloatArray) -> onnx.GraphProto:
    """`Student` as a graph from `obs` (B, 78) to `actions` (B, 14); see `student.py` for what it computes, and why.

    Inside, the rows of the first axis are arms, 2 B of them: of each observation the left, then the mirrored right one.
    """
    g, bodies = SampleGraph(weights), np.stack([POSITION_SIGN, POSITION_SIGN])
    obs = g("Mul", "obs", g.constant(_signs(bodies, ORIENTATION_SIGN, JOINT_SIGN, JOINT_SIGN, JOINT_SIGN)))
    position = g.reshape(g.columns(obs, 0, 12), -1, 2, 3)
    columns = g.reshape(g.columns(obs, 12, 36), -1, 2, 3, 2)
    joints, velocity, last_action = (
        g.reshape(g.columns(obs, start, start + 14), -1, ARM_JOINTS) for start in (36, 50, 64)
    )
    rotation = g("Concat", columns, g.cross(columns), axis=-1)
    elbow, hand = g.pick(rotation, 0), g.pick(rotation, 1)
    offset = g("Mul", g("Sub", g.pick(position, 0), g.constant(origin)), g.constant(scales.LENGTH))
    relative = g("MatMul", g("Transpose", elbow, perm=[0, 2, 1]), hand)

    first = g.columns(joints, 0, scales.ELBOW_JOINTS)
    shoulder = g.perceptron("shoulder", g("Concat", offset, g.reshape(elbow, -1, 9), first, axis=-1))
    wrist = g.perceptron("wrist", g.reshape(relative, -1, 9))
    solution = g("Concat", shoulder, wrist, axis=-1)

    action_scale = g.constant(scales.ACTION)
    features = g(
        "Concat",
        solution,
        g("Mul", velocity, g.constant(scales.VELOCITY)),
        g("Mul", g("Sub", g("Mul", solution, action_scale), joints), g.constant(scales.TRACKING)),
        g("Mul", g("Sub", last_action, solution), g.constant(scales.CHANGE)),
        g("Mul", g("Sub", g("Mul", last_action, action_scale), joints), g.constant(scales.LEAD)),
        axis=-1,
    )
    correction = g("Mul", g.perceptron("feedback", features), g.constant(scales.CORRECTION))
    command = g("Mul", g("Add", solution, correction), action_scale)
    largest = g.constant(scales.LARGEST_LEAD)
    lead = g("Mul", g("Tanh", g("Div", g("Sub", command, joints), largest)), largest)
    action = g("Div", g("Add", joints, lead), action_scale)
    g("Mul", g.reshape(action, -1, 2 * ARM_JOINTS), g.constant(_signs(JOINT_SIGN)), name="actions")
    return g.build("lite_tracking", obs=78, actions=14)


def _signs(*right: FloatArray) -> FloatArray:
    """Return ones for the left arm's values of terms that hold both arms, and `right` for those of the other."""
    return np.concatenate([np.concatenate([np.ones(sign.size), sign.ravel()]) for sign in right])
