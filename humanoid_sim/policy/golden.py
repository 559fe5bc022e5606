"""Golden vectors: samples of a trainer's run in a checkpoint's metadata, computed again at every load."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.controllers.policy_step import PolicyMemory, PolicyWiring, action_command
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.errors import FieldError, InputError, reason_of
from humanoid_sim.mit import Float32Array
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.readers.own import GOLDEN_KEY
from humanoid_sim.policy.traces import MUJOCO_VERSION, REFERENCE, STATE_ARRAYS, Trace

SAMPLE_COUNT = 8
_TOLERANCES = {"observation": 1e-4, "action": 1e-3, "target": 1e-4}
"""Absolute for values up to 1, relative beyond; targets in rad. float32 sums in another order stay below, wrong wiring
does not; networks amplify the rounding of other hardware."""
_ROUNDING = 0.5e-3  # largest error of an action scale or offset with three decimals
_NO_LIMIT = 1e9  # a recorded action is what it is
_VERSION = 1
_TYPES = dict.fromkeys(("last_action", "observation", "action", "history"), "<f4") | {"frame": "<i8"}


def trainer_samples(checkpoint: Checkpoint, trace: Trace, motion: Motion | None = None) -> Trace:
    """Return samples of a trainer's run, spread evenly over it, after every step of it has been computed again.

    Raises `InputError` if the checkpoint's observation, action or targets differ from the trainer's; the line names the
    first step, term and joint, and both values.

    Args:
        motion: what the run followed, where the model does not carry it.
    """
    whole = with_memory(checkpoint, trace, motion)
    problem = golden_problem(checkpoint, whole)
    if problem:
        raise InputError(f"{checkpoint.source}: {problem}")
    return whole.rows(np.unique(np.linspace(0, len(whole) - 1, SAMPLE_COUNT).round().astype(np.intp)))


def with_memory(checkpoint: Checkpoint, trace: Trace, motion: Motion | None = None) -> Trace:
    """Return a run with what the policy remembered in each step, from activation on, and with the motion's rows."""
    loaded = checkpoint.following(motion)
    entered: list[PolicyMemory] = []
    where = ""
    try:
        wiring = _recorded_wiring(loaded, trace.joint_names)
        memory = wiring.activate(trace.state(0))
        for i in range(len(trace)):
            where = f"step {i}: "
            memory = trace.memory(i, memory)
            entered.append(memory)
            _, observed = wiring.observe(memory, trace.state(i))
            memory, _ = wiring.act(observed, trace.arrays["action"][i])
    except (FieldError, ValueError) as error:
        raise InputError(f"{checkpoint.source}: on {trace.name}: {where}{error}") from None
    frame = np.array([memory.frame for memory in entered], dtype=np.int64)
    nowhere = np.full(7, np.nan)
    laid = [memory.alignment for memory in entered]
    arrays = {
        **trace.arrays,
        "last_action": np.stack([memory.last_action for memory in entered]),
        "frame": frame,
        "walked": np.array([memory.walked for memory in entered], dtype=np.float64),
        "alignment": np.stack([nowhere if one is None else np.concatenate([one.offset, one.yaw]) for one in laid]),
    }
    histories = [memory.history for memory in entered]
    known = next((history for history in histories if history is not None), None)
    if known is not None:
        missing = np.full_like(known, np.nan)
        arrays["history"] = np.stack([missing if history is None else history for history in histories])
    reference = loaded.reference
    if checkpoint.motion is None:
        rows = reference.clamp(frame)
        arrays |= {REFERENCE + name: np.asarray(table[rows]) for name, table in reference.terms.items()}
    return replace(trace, arrays=arrays, frame_count=reference.frame_count)


def verify_golden(checkpoint: Checkpoint) -> str:
    """Check a checkpoint against its golden vectors, and return what they are worth in words; '' without any.

    Raises `InputError` with the first sample, term and joint that differ, and both values; or for malformed samples.
    """
    samples = stored_samples(checkpoint)
    if samples is None:
        return ""
    problem = golden_problem(checkpoint, samples)
    if problem:
        raise InputError(f"{checkpoint.source}: golden vectors: {problem}")
    return samples_label(samples)


def samples_label(samples: Trace) -> str:
    """Return what samples are worth, in words."""
    unproved = "" if "target" in samples.arrays else "; without joint targets, so scale and offset are not proved"
    return f"{len(samples)} samples of the trainer's run ({samples.name}){unproved}"


def golden_problem(checkpoint: Checkpoint, samples: Trace) -> str:
    """Return what differs between samples and what the checkpoint makes of their states, '' if nothing does.

    The observation and the targets are computed by the functions that run on the robot, the action by the model from
    the sample's observation.
    """
    contract, arrays = checkpoint.contract, samples.arrays
    start = PolicyMemory(0, np.zeros(contract.action_count, dtype=np.float32))
    try:
        wiring = _samples_wiring(checkpoint, samples)
        seen = [wiring.observe(samples.memory(i, start), samples.state(i))[0] for i in range(len(samples))]
        position = action_command(wiring.action_map, arrays["action"]).position
    except (FieldError, InputError, ValueError) as error:
        return f"cannot be computed: {str(error).removeprefix(f'{checkpoint.source}: ')}"
    layout = wiring.layout
    names = [_value_name(layout, checkpoint, i) for i in range(layout.width)]
    problem = _difference(samples, "observation", np.stack(seen), names)
    if problem:
        return problem
    frames = arrays["frame"].tolist()
    try:
        answers = [checkpoint.policy(row, frame) for row, frame in zip(arrays["observation"], frames, strict=True)]
    except Exception as error:  # the policy is foreign code
        return f"the model fails on a sample: {reason_of(error)}"
    problem = _difference(samples, "action", np.asarray(answers), contract.action_joint_names)
    if problem or "target" not in arrays:
        return problem
    problem = _difference(samples, "target", position, samples.joint_names)
    rounding = _ROUNDING * (1.0 + np.abs(arrays["action"]).max())
    if problem and np.abs(position - arrays["target"]).max() <= rounding:
        problem += ", or only rounded by its exporter: x.contract.yaml can hold the trainer's own action_scale"
    return problem


def _samples_wiring(checkpoint: Checkpoint, samples: Trace) -> PolicyWiring:
    """Return the wiring that computes samples again, with their own rows of the motion if they hold any."""
    tables: dict[str, Float32Array] = {}
    for name, rows in samples.under(REFERENCE).items():
        tables[name] = np.zeros((samples.frame_count, rows.shape[1]), dtype=np.float32)
        tables[name][samples.arrays["frame"]] = rows
    if not tables:
        return _recorded_wiring(checkpoint.following(), samples.joint_names)
    reference = MotionReference(samples.frame_count, tables)
    return _recorded_wiring(LoadedPolicy(checkpoint.contract, reference, checkpoint.policy), samples.joint_names)


def _recorded_wiring(loaded: LoadedPolicy, joint_names: tuple[str, ...]) -> PolicyWiring:
    return PolicyWiring(joint_names, loaded.contract, loaded.reference, loaded.extern, action_limit=_NO_LIMIT)


def _value_name(layout: ObservationLayout, checkpoint: Checkpoint, index: int) -> str:
    """Return the value at `index` of the whole observation, and its joint: `joint_pos[3] (left_knee_joint)`."""
    located = layout.locate(index)
    name, _, rest = located.partition("[")
    place = int(rest.partition("]")[0])
    term = next(term.term for term in layout.terms if term.name == name)
    joints = value_names(term, checkpoint.contract)
    return f"{located} ({joints[place]})" if place < len(joints) else located


def _difference(
    samples: Trace,
    kind: Literal["observation", "action", "target"],
    values: npt.NDArray[np.floating],
    names: Sequence[str],
) -> str:
    """Return what is too far off the samples' own, '' if nothing is.

    Args:
        samples: with the array `kind`, (S, width), that is expected.
        values: shape (S, width).
        names: of the columns: term and place, or joint.
    """
    expected = samples.arrays[kind]
    if values.shape != expected.shape:
        return f"hold {kind}s of {expected.shape[-1]} values, the contract makes {values.shape[-1]}"
    with np.errstate(invalid="ignore"):  # infinity - infinity
        far = ~(np.abs(values - expected) <= _TOLERANCES[kind] * np.maximum(1.0, np.abs(expected)))
    if not far.any():
        return ""
    i = int(np.argmax(far.any(axis=1)))
    index = int(np.argmax(far[i]))
    theirs = samples.mujoco_version
    versions = f" (recorded with MuJoCo {theirs}; here it is {mujoco.__version__})" if theirs else ""
    return (
        f"sample {i} of {samples.name}: {kind} {'' if kind == 'observation' else 'of '}{names[index]} is "
        f"{values[i, index]:.6g}, the trainer's is {expected[i, index]:.6g} ({far[i].sum()} of {len(names)} values "
        f"differ): the policy is wired differently here than where it was trained{versions}"
    )


def encode_samples(samples: Trace) -> str:
    """Return one line of JSON from which `stored_samples` makes the same samples, bit for bit."""
    arrays = {
        name: {"shape": array.shape, "data": base64.b64encode(array.astype(_type(name)).tobytes()).decode()}
        for name, array in samples.arrays.items()
    }
    document = {
        "version": _VERSION,
        "origin": "trainer",
        "source": samples.name,
        "joint_names": samples.joint_names,
        "frame_count": samples.frame_count,
        MUJOCO_VERSION: samples.mujoco_version,
        "arrays": arrays,
    }
    return json.dumps(document)


def stored_samples(checkpoint: Checkpoint) -> Trace | None:
    """Return a trainer's samples in a checkpoint's metadata; None without any.

    Raises `InputError` if they are malformed.
    """
    if GOLDEN_KEY not in checkpoint.metadata:
        return None
    try:
        document = json.loads(checkpoint.metadata[GOLDEN_KEY])
        if document["version"] != _VERSION:
            raise ValueError(f"version is {document['version']!r}, expected {_VERSION}")
        if document["origin"] != "trainer":  # of the program's own wiring, which proves nothing
            return None
        arrays = {name: _decoded(name, value) for name, value in document["arrays"].items()}
        missing = {*STATE_ARRAYS, "observation", "action", "last_action", "frame"} - arrays.keys()
        if missing or len({len(array) for array in arrays.values()}) != 1 or not len(arrays["action"]):
            raise ValueError(f"lack {', '.join(sorted(missing)) or 'samples'}")
        joints, count = tuple(map(str, document["joint_names"])), int(document["frame_count"])
        return Trace(str(document["source"]), joints, arrays, count, str(document.get(MUJOCO_VERSION, "")))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{checkpoint.source}: golden vectors: malformed ({reason_of(error)}); stamp it again"
        ) from None


def _type(name: str) -> str:
    return "<f4" if name.startswith(REFERENCE) else _TYPES.get(name, "<f8")


def _decoded(name: str, value: Any) -> npt.NDArray[Any]:
    data = base64.b64decode(value["data"], validate=True)
    return np.frombuffer(data, dtype=_type(name)).reshape(value["shape"])  # read-only, as the bytes are
