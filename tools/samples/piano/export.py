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
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT
from tools.samples.graph import SampleGraph, write_model
from tools.samples.piano.hands import FAR, NONE, POLICY_DT, Motion, Moves, home
from tools.samples.piano.pointer import FEATURES, LOOKAHEAD, OFFSETS

__all__ = ["OBSERVATIONS", "export_piano_policy", "piano_contract"]

Arms = tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]

OBSERVATIONS = ("actions", "key_pressed", "target_keys", "target_keys_future")
_ARM = 7


def piano_contract(description: RobotDescription, default: FloatArray) -> PolicyContract:
    """Return the contract of the sample policy; `default`, shape (14,), rad, is commanded while the action is 0."""
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
    moves: tuple[Moves, Moves],
    arms: Arms,
    description: RobotDescription,
    motion: Motion,
) -> None:
    """Write the policy with its metadata; an existing file is replaced only by a whole one.

    Raises `InputError` if the file cannot be written.

    Args:
        path: of the .onnx file.
        weights: of a `Pointer`, by the names of its parameters.
        moves: of both hands.
        arms: the places of their joints, shape (7,) each, among the robot's.
        description: of the robot.
        motion: the rule by which the hands go.
    """
    default = np.empty(description.joint_count)
    for hand, row in enumerate(home(moves)):
        default[arms[hand]] = moves[hand].command[row]
    write_model(
        path, _graph(weights, moves, arms, default, motion), write_metadata(piano_contract(description, default))
    )


def _graph(
    weights: Mapping[str, npt.NDArray[np.float32]],
    moves: tuple[Moves, Moves],
    arms: Arms,
    default: FloatArray,
    motion: Motion,
) -> onnx.GraphProto:
    """From `obs` (B, N) to `actions` (B, 14)."""
    g = SampleGraph(weights)
    joints, seen_from = 2 * _ARM, 2 * _ARM + KEY_COUNT
    width = seen_from + KEY_COUNT * len(OFFSETS)
    one, far = g.constant(1.0), g.constant(FAR)
    ahead = g.constant(OFFSETS[:, None])
    seen = g.reshape(g.columns("obs", seen_from, width), -1, len(OFFSETS), KEY_COUNT)
    silent = g("Sub", one, seen)
    begins = g("ReduceMin", g("Add", ahead, g("Mul", far, silent)), axes=[1], keepdims=1)
    ends = g("Mul", silent, g("Cast", g("Greater", ahead, begins), to=onnx.TensorProto.FLOAT))
    wait = g.reshape(begins, -1, KEY_COUNT)
    stops = g("ReduceMin", g("Add", ahead, g("Mul", far, g("Sub", one, ends))), axes=[1], keepdims=1)
    left = g.reshape(stops, -1, KEY_COUNT)
    asked = g("Mul", seen, g("Cast", g("Greater", ahead, stops), to=onnx.TensorProto.FLOAT))
    again = g("ReduceMin", g("Add", ahead, g("Mul", far, g("Sub", one, asked))), axes=[1], keepdims=0)

    command = g("Add", g.columns("obs", 0, joints), g.constant(default))
    tables = [g.constant(own.command.T, f"commands.{hand}") for hand, own in enumerate(moves)]
    rows = []
    for hand, table in enumerate(tables):
        arm = g("Gather", command, g.constant(arms[hand], dtype=np.int64), axis=1)
        error = g("Sub", table, g.reshape(arm, -1, _ARM, 1))
        distance = g("ReduceSumSquare", error, axes=[1], keepdims=0)
        rows.append(g("ArgMin", distance, axis=1, keepdims=1))

    answer = _pointed(g, weights, (wait, left, again), g.columns("obs", joints, seen_from), moves, rows)
    actions = []
    for hand, row in enumerate(_moved(g, motion, moves, rows, answer, (wait, left, again))):
        pose = g("Transpose", g.reshape(g("Gather", tables[hand], row, axis=1), _ARM, -1), perm=[1, 0])
        actions.append(g("Sub", pose, g.constant(default[arms[hand]])))
    order = np.argsort(np.concatenate(arms))
    g("Gather", g("Concat", *actions, axis=1), g.constant(order, dtype=np.int64), axis=1, name="actions")
    return g.build("lite_piano", obs=width, actions=joints)


def _of_row(g: SampleGraph, values: npt.NDArray[np.generic], row: str, to: int = onnx.TensorProto.INT64) -> str:
    """Return what a table has in the rows (B, 1); integers are stored as small as they are."""
    small = values.astype(np.uint8 if values.max() < 256 else np.int32) if values.dtype.kind in "iu" else values
    dtype = np.float32 if small.dtype.kind == "f" else small.dtype.type
    found = g("Gather", g.constant(small, dtype=dtype), row, axis=0)
    return found if small.dtype == np.bool_ else g("Cast", found, to=to)


def _pointed(
    g: SampleGraph,
    weights: Mapping[str, npt.NDArray[np.float32]],
    times: tuple[str, str, str],
    pressed: str,
    moves: tuple[Moves, Moves],
    rows: list[str],
) -> str:
    """Return the key of each hand, (B, 2), `NONE` for none: `key_features` and `Pointer`."""
    most, keys = g.constant(60.0), g.constant(np.arange(KEY_COUNT))
    wait = times[0]
    near, soon, later = (g("Min", part, most) for part in times)
    zeros = g("Mul", wait, g.constant(0.0))

    def fading(value: str, steps: float) -> str:
        return g("Exp", g("Div", value, g.constant(-steps)))

    real = onnx.TensorProto.FLOAT
    away, busy, depth = [], [], []
    for own, row in zip(moves, rows, strict=True):
        away.append(g("Div", g("Sub", keys, _of_row(g, own.key, row, real)), g.constant(20.0)))
        busy.append(g("Add", zeros, g("Div", _of_row(g, own.busy, row, real), g.constant(10.0))))
        depth.append(g("Add", zeros, _of_row(g, own.depth, row, real)))
    columns = [
        g("Cast", g("Equal", wait, g.constant(0.0)), to=onnx.TensorProto.FLOAT),
        fading(near, 6.0),
        fading(near, 20.0),
        g("Div", near, most),
        fading(soon, 6.0),
        g("Div", soon, most),
        fading(later, 6.0),
        g("Div", later, most),
        g("Add", zeros, g.constant(np.arange(KEY_COUNT) / 44.0 - 1.0)),
        *away,
        *(g("Abs", distance) for distance in away),
        *busy,
        *depth,
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


def _moved(
    g: SampleGraph,
    motion: Motion,
    moves: tuple[Moves, Moves],
    rows: list[str],
    answer: str,
    times: tuple[str, str, str],
) -> list[str]:
    """Return the next row of each hand, (B, 1): `Motion.step`."""
    far, none = g.constant(FAR), g.constant(NONE, dtype=np.int64)
    here = [_of_row(g, own.key, row) for own, row in zip(moves, rows, strict=True)]
    points, aim = [], []
    begins: list[str] = []
    ends: list[str] = []
    repeats: list[str] = []
    for hand, own in enumerate(moves):
        pointed = g.columns(answer, hand, hand + 1)
        points.append(g("Less", pointed, none))
        in_song = g("Min", pointed, g.constant(KEY_COUNT - 1, dtype=np.int64))
        for found, part in zip((begins, ends, repeats), times, strict=True):
            found.append(g("Where", points[hand], g("GatherElements", part, in_song, axis=1), far))
        lowest, highest = (g.constant(key, dtype=np.int64) for key in (own.lowest, own.highest))
        aim.append(g("Min", g("Max", g("Where", points[hand], pointed, here[hand]), lowest), highest))
    yields = g("Less", begins[1], begins[0]), g("LessOrEqual", begins[0], begins[1])
    found = []
    for hand, own in enumerate(moves):
        row, key, other = rows[hand], here[hand], 1 - hand
        nearer, farther, apart = ("Min", "Max", -motion.apart) if hand == 0 else ("Max", "Min", motion.apart)
        coming = g("Where", yields[hand], aim[other], here[other])
        taken = g(nearer, g(nearer, _of_row(g, moves[other].origin, rows[other]), here[other]), coming)
        to = g(nearer, aim[hand], g("Add", taken, g.constant(apart, dtype=np.int64)))
        bound = own.lowest if hand == 0 else own.highest
        to = g(farther, to, g.constant(bound, dtype=np.int64))
        lasts = g("And", g("Equal", aim[hand], key), g("Greater", ends[hand], g.constant(float(motion.stops))))
        lasts = g("And", points[hand], lasts)
        once = g("Greater", repeats[hand], g.constant(float(motion.repeats)))
        in_time = g("LessOrEqual", g("Where", once, begins[hand], repeats[hand]), g.constant(float(motion.sounds)))
        follows, index = _of_row(g, own.follows, row), g("Sub", key, g.constant(own.lowest, dtype=np.int64))
        stays = g("Where", g("And", lasts, in_time), _of_row(g, own.press, index), follows)
        count = g.constant(len(own.over), dtype=np.int64)
        way = g("Add", g("Mul", index, count), g("Sub", to, g.constant(own.lowest, dtype=np.int64)))
        goes = g("Where", g("Equal", to, key), stays, _of_row(g, own.way.ravel(), way))
        leaves = g("Where", g("And", lasts, once), follows, _of_row(g, own.release, index))
        free = g("Where", _of_row(g, own.is_over, row), goes, follows)
        found.append(g("Where", _of_row(g, own.is_down, row), leaves, free))
    return found
