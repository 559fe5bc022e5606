"""The trained network as an ONNX file that describes itself.

The graph is written out by hand, operator by operator: it is small, it needs no exporter of PyTorch's, and its node
names can be read in any viewer. `train` checks it against the network it was made from.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.files import whole_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.training import scales
from humanoid_sim.training.arm import ARM_JOINTS, JOINT_SIGN, ORIENTATION_SIGN, POSITION_SIGN
from humanoid_sim.training.motions import BODIES, POLICY_DT, SAMPLE_DATASET, pose_a

__all__ = ["OBSERVATIONS", "export_policy", "policy_graph", "sample_contract"]

OBSERVATIONS = ("motion_body_pos_b", "motion_body_ori_b", "joint_pos", "joint_vel", "actions")

_OPSET = 17
_IR_VERSION = 8  # of the time of opset 17: runtimes from 2022 on read it


def sample_contract(description: RobotDescription) -> PolicyContract:
    """The contract of the sample policy on a robot with two of the Lite's arms."""
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

    Args:
        path: of the .onnx file.
        weights: of an `ArmNetwork`, by the names of its parameters.
        origin: shape (3,), m, base frame: the left shoulder.
        contract: becomes the metadata.

    Raises:
        InputError: if the file cannot be written.
    """
    model = helper.make_model(
        policy_graph(weights, origin),
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        producer_name="humanoid_sim.training",
    )
    helper.set_model_props(model, write_metadata(contract))
    onnx.checker.check_model(model, full_check=True)
    with whole_file(path) as file:
        file.write(model.SerializeToString())


def policy_graph(weights: Mapping[str, npt.NDArray[np.float32]], origin: FloatArray) -> onnx.GraphProto:
    """`Student` as a graph from `obs` (B, 78) to `actions` (B, 14); see `student.py` for what it computes, and why.

    Inside, the rows of the first axis are arms, 2 B of them: of each observation the left, then the mirrored right one.
    """
    g, bodies = _Graph(weights), np.stack([POSITION_SIGN, POSITION_SIGN])
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
    return g.build(obs=78, actions=14)


def _signs(*right: FloatArray) -> FloatArray:
    """Of terms that hold both arms: ones for the left arm's values, and `right` for those of the other."""
    return np.concatenate([np.concatenate([np.ones(sign.size), sign.ravel()]) for sign in right])


class _Graph:
    """Collects nodes and constants; every method returns the name of a value."""

    def __init__(self, weights: Mapping[str, npt.NDArray[np.float32]]) -> None:
        self._weights = weights
        self._nodes: list[onnx.NodeProto] = []
        self._constants: dict[str, npt.NDArray[np.generic]] = {}

    def __call__(self, operator: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        output = name or f"{operator.lower()}_{len(self._nodes)}"
        self._nodes.append(helper.make_node(operator, list(inputs), [output], name=output, **attributes))
        return output

    def constant(self, value: npt.ArrayLike, name: str = "", dtype: type = np.float32) -> str:
        name = name or f"constant_{len(self._constants)}"
        self._constants[name] = np.asarray(value, dtype=dtype)
        return name

    def columns(self, value: str, start: int, stop: int) -> str:
        bounds = [self.constant([bound], dtype=np.int64) for bound in (start, stop, 1)]
        return self("Slice", value, *bounds)

    def reshape(self, value: str, *shape: int, name: str = "") -> str:
        return self("Reshape", value, self.constant(shape, dtype=np.int64), name=name)

    def pick(self, value: str, body: int) -> str:
        """One body of (arms, bodies, ...)."""
        return self("Gather", value, self.constant(body, dtype=np.int64), axis=1)

    def cross(self, columns: str) -> str:
        """Third columns (2 B, 2, 3, 1) of rotation matrices from the first two, (2 B, 2, 3, 2)."""
        x, y = (self("Gather", columns, self.constant([i], dtype=np.int64), axis=3) for i in (0, 1))
        forward, backward = (self.constant(order, dtype=np.int64) for order in ([1, 2, 0], [2, 0, 1]))
        plus = self("Mul", self("Gather", x, forward, axis=2), self("Gather", y, backward, axis=2))
        minus = self("Mul", self("Gather", x, backward, axis=2), self("Gather", y, forward, axis=2))
        return self("Sub", plus, minus)

    def perceptron(self, name: str, value: str) -> str:
        """Linear layers with SiLU between them."""
        layers = sorted({int(key.split(".")[1]) for key in self._weights if key.startswith(f"{name}.")})
        for layer in layers:
            kernel, bias = (
                self.constant(self._weights[f"{name}.{layer}.{kind}"], f"{name}.{layer}.{kind}")
                for kind in ("weight", "bias")
            )
            value = self("Gemm", value, kernel, bias, name=f"{name}.{layer}", transB=1)
            if layer != layers[-1]:
                value = self("Mul", value, self("Sigmoid", value))
        return value

    def build(self, **ends: int) -> onnx.GraphProto:
        """The graph; `ends` are its input and its output, with their widths. How many rows there are is left open."""
        (source, sink) = (
            helper.make_tensor_value_info(name, TensorProto.FLOAT, ("batch", width)) for name, width in ends.items()
        )
        constants = [numpy_helper.from_array(value, name) for name, value in self._constants.items()]
        return helper.make_graph(self._nodes, "lite_tracking", [source], [sink], constants)
