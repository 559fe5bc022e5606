"""A network that plays two keys, one a hand: it presses each while the song asks for it. Exactly solvable, so real."""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.fingers import Fingers

KEYS = (34, 53)
"""G3 for the left hand, D5 for the right."""
_HOVER = 0.006
"""m of the fingers above the keys."""


def two_key_policy(path: Path, robot: RobotDescription | None = None) -> Path:
    """Write it as a piano policy, and return its path: action = the goals of the two keys, each times a pose."""
    robot = load_robot("lite_piano") if robot is None else robot
    fingers = Fingers(robot)
    above = fingers.ready.copy()
    weights = np.zeros((2 * 88, robot.joint_count), dtype=np.float32)
    for hand, key in enumerate(KEYS):
        arm = fingers.arms[hand]
        raised = fingers.solve(hand, fingers.tip_above(fingers.keys[key], _HOVER))
        pressed = fingers.solve(hand, fingers.tip_above(fingers.keys[key], 0.0, 0.9), raised)
        # The commanded pose is beyond the real one by what holds the arm: gravity, and the key.
        above[arm] = raised + fingers.holding_torque(hand, raised, 0.0) / robot.stiffness[arm]
        down = pressed + fingers.holding_torque(hand, pressed, 2.0) / robot.stiffness[arm]
        weights[key, arm] = down - above[arm]
    contract = PolicyContract(
        task_type="piano",
        joint_names=robot.joint_names,
        action_joint_names=robot.joint_names,
        joint_stiffness=robot.stiffness,
        joint_damping=robot.damping,
        default_joint_pos=above,
        observation=("target_keys", "key_pressed"),
        command_names=(),
        action_scale=np.ones(robot.joint_count),
        policy_dt=0.02,
        body_names=(),
    )
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["observation", "weights"], ["action"])],
        "two keys",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, len(weights)])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, robot.joint_count])],
        [numpy_helper.from_array(weights, "weights")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    for key, value in write_metadata(contract).items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.save(model, str(path))
    return path
