"""The piano policy as an ONNX file that describes itself: what the hands' last commands say, the pointer, and the rule.

The graph is written out by hand, as that of the tracking policy; `pointer.py` and `hands.py` say what it computes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnx

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.evaluation.key_poses import KeyPoses
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.training.graph import Graph, write_model
from humanoid_sim.training.piano.hands import BOTTOM, FAR, HOVERING, LEVELS, QUARTERS, Motion, home, pose_grid
from humanoid_sim.training.piano.pointer import FEATURES, LOOKAHEAD, OFFSETS

__all__ = ["OBSERVATIONS", "POLICY_DT", "export_piano_policy", "piano_contract"]

POLICY_DT = 0.02
"""s"""
OBSERVATIONS = ("actions", "key_pressed", "target_keys", "target_keys_future")
_ARM = 7


def piano_contract(description: RobotDescription, default: FloatArray) -> PolicyContract:
    """The contract of the sample policy; `default`, shape (14,), rad, is commanded while the action is 0."""
    joints = description.joint_names
    return PolicyContract(
        task_type="piano",
        joint_names=joints,
        action_joint_names=joints,
        joint_stiffness=description.stiffness,
        joint_damping=description.damping,
        default_joint_pos=default,
        observation=OBSERVATIONS,
        command_names=(),
        action_scale=np.ones(len(joints)),
        policy_dt=POLICY_DT,
        body_names=(),
        lookahead_steps=LOOKAHEAD,
    )


def export_piano_policy(
    path: Path,
    weights: Mapping[str, npt.NDArray[np.float32]],
    poses: KeyPoses,
    description: RobotDescription,
    motion: Motion,
) -> None:
    """Write the policy with its metadata; an existing file is replaced only by a whole one.

    Args:
        path: of the .onnx file.
        weights: of a `Pointer`, by the names of its parameters.
        poses: of the robot.
        description: of the robot.
        motion: the rule by which the hands go.

    Raises:
        InputError: if the file cannot be written.
    """
    grids = [pose_grid(poses, hand) for hand in (0, 1)]
    default = np.empty(description.joint_count)
    for hand, (place, level) in enumerate(home(poses)):
        default[poses.arms[hand]] = grids[hand][place, level]
    write_model(
        path, _graph(weights, poses, grids, default, motion), write_metadata(piano_contract(description, default))
    )


def _graph(
    weights: Mapping[str, npt.NDArray[np.float32]],
    poses: KeyPoses,
    grids: list[FloatArray],
    default: FloatArray,
    motion: Motion,
) -> onnx.GraphProto:
    """From `obs` (B, N) to `actions` (B, 14)."""
    g = Graph(weights)
    joints, seen_from = 2 * _ARM, 2 * _ARM + KEY_COUNT
    width = seen_from + KEY_COUNT * len(OFFSETS)
    one, far = g.constant(1.0), g.constant(FAR)
    ahead = g.constant(OFFSETS[:, None])
    seen = g.reshape(g.columns("obs", seen_from, width), -1, len(OFFSETS), KEY_COUNT)
    silent = g("Sub", one, seen)
    begins = g("ReduceMin", g("Add", ahead, g("Mul", far, silent)), axes=[1], keepdims=1)
    ends = g("Mul", silent, g("Cast", g("Greater", ahead, begins), to=onnx.TensorProto.FLOAT))
    wait = g.reshape(begins, -1, KEY_COUNT)
    left = g("ReduceMin", g("Add", ahead, g("Mul", far, g("Sub", one, ends))), axes=[1], keepdims=0)

    command = g("Add", g.columns("obs", 0, joints), g.constant(default))
    tables = [g.constant(grid.reshape(-1, _ARM), f"poses.{hand}") for hand, grid in enumerate(grids)]
    places, levels = [], []
    for hand, grid in enumerate(grids):
        table = g.constant(_told_apart(grid).reshape(-1, _ARM))
        arm = g("Gather", command, g.constant(poses.arms[hand], dtype=np.int64), axis=1)
        error = g("Sub", table, g.reshape(arm, -1, 1, _ARM))
        distance = g("ReduceSum", g("Mul", error, error), g.constant([2], dtype=np.int64), keepdims=0)
        index = g("ArgMin", distance, axis=1, keepdims=1)
        count = g.constant(len(LEVELS), dtype=np.int64)
        places.append(g("Cast", g("Div", index, count), to=onnx.TensorProto.FLOAT))
        levels.append(g("Cast", g("Mod", index, count), to=onnx.TensorProto.FLOAT))

    answer = _pointed(g, weights, wait, left, g.columns("obs", joints, seen_from), places, levels, poses)
    actions = []
    for hand, table in enumerate(tables):
        keys = poses.keys[hand]
        own = g.columns(answer, hand, hand + 1)
        points = g("Less", own, g.constant(KEY_COUNT, dtype=np.int64))
        low, high = (g.constant(keys[i], dtype=np.int64) for i in (0, -1))
        key = g("Min", g("Max", own, low), high)
        begin, end = (g("Where", points, g("GatherElements", part, key, axis=1), far) for part in (wait, left))
        quarters = g.constant(float(QUARTERS))
        over = g("Mul", g("Cast", g("Sub", key, low), to=onnx.TensorProto.FLOAT), quarters)
        resting = g("Mul", g("Round", g("Div", places[hand], quarters)), quarters)
        there, level = _moved(g, motion, places[hand], levels[hand], g("Where", points, over, resting), begin, end)
        index = g("Add", g("Mul", there, g.constant(float(len(LEVELS)))), level)
        last = g.constant(float(grids[hand].shape[0] * len(LEVELS) - 1))
        index = g("Cast", g("Clip", index, g.constant(0.0), last), to=onnx.TensorProto.INT64)
        pose = g.reshape(g("Gather", table, index, axis=0), -1, _ARM)
        actions.append(g("Sub", pose, g.constant(default[poses.arms[hand]])))
    order = np.argsort(np.concatenate(poses.arms))
    g("Gather", g("Concat", *actions, axis=1), g.constant(order, dtype=np.int64), axis=1, name="actions")
    return g.build("lite_piano", obs=width, actions=joints)


def _told_apart(grid: FloatArray) -> FloatArray:
    """The grid, with poses on a key only over its middle: beside it they are the same, and no hand is there."""
    places = grid.copy()
    places[np.arange(len(grid)) % QUARTERS != 0, HOVERING + 1 :] = FAR
    return places


def _pointed(
    g: Graph,
    weights: Mapping[str, npt.NDArray[np.float32]],
    wait: str,
    left: str,
    pressed: str,
    places: list[str],
    levels: list[str],
    poses: KeyPoses,
) -> str:
    """The key of each hand, (B, 2), 88 for none: `key_features` and `Pointer`."""
    most, keys = g.constant(60.0), g.constant(np.arange(KEY_COUNT))
    near, soon = g("Min", wait, most), g("Min", left, most)
    zeros = g("Mul", wait, g.constant(0.0))

    def fading(value: str, steps: float) -> str:
        return g("Exp", g("Div", value, g.constant(-steps)))

    away = []
    for hand, place in enumerate(places):
        over = g("Add", g("Div", place, g.constant(float(QUARTERS))), g.constant(float(poses.keys[hand][0])))
        away.append(g("Div", g("Sub", keys, over), g.constant(20.0)))
    columns = [
        g("Cast", g("Equal", wait, g.constant(0.0)), to=onnx.TensorProto.FLOAT),
        fading(near, 6.0),
        fading(near, 20.0),
        g("Div", near, most),
        fading(soon, 6.0),
        g("Div", soon, most),
        g("Add", zeros, g.constant(np.arange(KEY_COUNT) / 44.0 - 1.0)),
        *away,
        *(g("Abs", distance) for distance in away),
        *(g("Add", zeros, g("Div", level, g.constant(8.0))) for level in levels),
        pressed,
    ]
    features = g("Concat", *(g.reshape(column, -1, KEY_COUNT, 1) for column in columns), axis=2)
    asked = g("Cast", g("Less", wait, g.constant(FAR)), to=onnx.TensorProto.FLOAT)
    asked = g.reshape(asked, -1, KEY_COUNT, 1)
    each = g("Relu", g.perceptron("each", g.reshape(features, -1, FEATURES), "Relu"))
    size = int(weights["none.0.weight"].shape[1])
    each = g("Mul", g.reshape(each, -1, KEY_COUNT, size), asked)
    pooled = g("ReduceMax", each, axes=[1], keepdims=1)
    both = g("Concat", each, g("Add", g("Mul", each, g.constant(0.0)), pooled), axis=2)
    scores = g.reshape(g.perceptron("among", g.reshape(both, -1, 2 * size), "Relu"), -1, KEY_COUNT, 2)
    scores = g("Sub", scores, g("Mul", g("Sub", g.constant(1.0), asked), g.constant(1e4)))
    none = g.reshape(g.perceptron("none", g.reshape(pooled, -1, size), "Relu"), -1, 1, 2)
    return g("ArgMax", g("Concat", scores, none, axis=1), axis=1, keepdims=0)


def _moved(g: Graph, motion: Motion, place: str, level: str, target: str, wait: str, left: str) -> tuple[str, str]:
    """`Motion.step` of one hand, (B, 1) each."""
    zero, hovering = g.constant(0.0), g.constant(float(HOVERING))
    way = g("Sub", target, place)
    fastest = float(motion.fastest)
    part = g("Clip", g("Round", g("Mul", way, g.constant(motion.gain))), g.constant(-fastest), g.constant(fastest))
    part = g("Where", g("LessOrEqual", g("Abs", way), g.constant(2.0)), way, part)
    there = g("Add", place, g("Where", g("LessOrEqual", level, hovering), part, zero))
    steps = g("Ceil", g("Div", g("Abs", g("Sub", target, there)), g.constant(float(motion.near))))
    lifted = g("Sub", hovering, g("Min", steps, hovering))
    in_time = g("LessOrEqual", wait, g.constant(float(motion.lead)))
    lasts = g("Greater", left, g.constant(float(motion.stops)))
    presses = g("And", g("Equal", way, zero), g("And", in_time, lasts))
    over = g("Where", g("Greater", level, hovering), hovering, lifted)
    goal = g("Where", presses, g.constant(float(BOTTOM)), over)
    release = g.constant(float(motion.release))
    rise = g("Where", g("GreaterOrEqual", level, hovering), g.constant(float(motion.press)), release)
    up = g("Min", g("Add", level, rise), goal)
    down = g("Max", g("Sub", level, release), goal)
    return there, g("Where", g("Greater", goal, level), up, down)
