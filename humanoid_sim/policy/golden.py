"""Golden vectors: samples of a trainer's run in a checkpoint's metadata, computed again at every load."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.policy_step import PolicyMemory, PolicyWiring, action_command
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.errors import FieldError, blaming
from humanoid_sim.mit import Float32Array
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.readers.own import GOLDEN_KEY
from humanoid_sim.policy.traces import REFERENCE, STATE_ARRAYS, Trace

_SAMPLES = 8
_TOLERANCES = {"observation": 1e-4, "action": 1e-3, "target": 1e-4}
"""Absolute for values up to 1, relative beyond; targets in rad. float32 sums in another order stay below, wrong wiring
does not; networks amplify the rounding of other hardware."""
_NO_LIMIT = 1e9  # a recorded action is what it is
_VERSION = 1
_FLOAT32 = ("last_action", "observation", "action", "history")


def trainer_samples(checkpoint: Checkpoint, trace: Trace, motion: Motion | None = None) -> Trace:
    """Return samples of a trainer's run, spread evenly over it, after every step of it has been computed again.

    Raises `InputError` with the first step, term and joint at which the checkpoint differs. `motion` is what the run
    followed, where the model does not carry it.
    """
    loaded = checkpoint.with_motion(motion)
    with blaming(checkpoint.source, (FieldError, ValueError)):
        whole = _with_memory(checkpoint, loaded, trace)
        _verify(checkpoint, whole)
    chosen = np.unique(np.linspace(0, len(whole) - 1, _SAMPLES).round().astype(np.intp))
    return replace(whole, arrays={name: array[chosen] for name, array in whole.arrays.items()})


def verify_golden(checkpoint: Checkpoint) -> str:
    """Check a checkpoint against its golden vectors, and return what they are worth in words; '' without any.

    Raises `InputError` with the first sample, term and joint that differ, and both values; or for malformed samples.
    """
    samples = stored_samples(checkpoint)
    if samples is None:
        return ""
    with blaming(f"{checkpoint.source}: golden vectors"):
        _verify(checkpoint, samples)
    return samples_label(samples)


def samples_label(samples: Trace) -> str:
    """Return what samples are worth, in words."""
    unproved = "" if "target" in samples.arrays else "; without joint targets, so scale and offset are not proved"
    return f"{len(samples)} samples of the trainer's run ({samples.name}){unproved}"


def _with_memory(checkpoint: Checkpoint, loaded: LoadedPolicy, trace: Trace) -> Trace:
    """Return a run with what the policy remembered in each step, from activation on, and with the motion's rows."""
    wiring = _wiring(loaded, trace.joint_names)
    memory, entered = wiring.activate(trace.state(0)), list[PolicyMemory]()
    for i in range(len(trace)):
        entered.append(trace.memory(i, memory))
        _, observed = wiring.observe(entered[i], trace.state(i))
        memory, _ = wiring.act(observed, trace.arrays["action"][i])
    alignments = [memory.alignment for memory in entered]
    arrays = {
        **trace.arrays,
        "last_action": np.stack([memory.last_action for memory in entered]),
        "frame": np.array([memory.frame for memory in entered], dtype=np.int64),
        "walked": np.array([memory.walked for memory in entered], dtype=np.float64),
        "alignment": np.stack([np.full(7, np.nan) if a is None else np.r_[a.offset, a.yaw] for a in alignments]),
    }
    if memory.history is not None:
        none = np.full_like(memory.history, np.nan)
        arrays["history"] = np.stack([none if memory.history is None else memory.history for memory in entered])
    reference = loaded.reference
    if checkpoint.motion is None:
        rows = reference.clamp(arrays["frame"])
        arrays |= {REFERENCE + name: np.asarray(table[rows]) for name, table in reference.terms.items()}
    return replace(trace, arrays=arrays, frame_count=reference.frame_count)


def _verify(checkpoint: Checkpoint, samples: Trace) -> None:
    """Raise `FieldError` with what differs between samples and what the checkpoint makes of their states.

    The observation and the targets are computed by the functions that run on the robot, the action by the model from
    the sample's observation.
    """
    arrays, frames = samples.arrays, samples.arrays["frame"].tolist()
    wiring = _wiring(_followed(checkpoint, samples), samples.joint_names)
    start = PolicyMemory(0, np.zeros(checkpoint.contract.action_count, dtype=np.float32))
    with blaming("cannot be computed", ValueError, FieldError):
        seen = [wiring.observe(samples.memory(i, start), samples.state(i))[0] for i in range(len(samples))]
        position = action_command(wiring.action_map, arrays["action"]).position
    names = [value_name(wiring, i) for i in range(wiring.layout.width)]
    _compare(samples, "observation", np.stack(seen), names)
    with blaming("the model fails on a sample", Exception, FieldError):  # the policy is foreign code
        answers = [checkpoint.policy(row, frame) for row, frame in zip(arrays["observation"], frames, strict=True)]
    _compare(samples, "action", np.asarray(answers), [f"of {name}" for name in wiring.contract.action_joint_names])
    if "target" in arrays:
        _compare(samples, "target", position, [f"of {name}" for name in samples.joint_names])


def _followed(checkpoint: Checkpoint, samples: Trace) -> LoadedPolicy:
    """Return the policy with the samples' own rows of the motion, if they hold any."""
    tables: dict[str, Float32Array] = {}
    for name, rows in samples.under(REFERENCE).items():
        tables[name] = np.zeros((samples.frame_count, rows.shape[1]), dtype=np.float32)
        tables[name][samples.arrays["frame"]] = rows
    if not tables:
        return checkpoint.with_motion()
    return LoadedPolicy(checkpoint.contract, MotionReference(samples.frame_count, tables), checkpoint.policy)


def _wiring(loaded: LoadedPolicy, joint_names: tuple[str, ...]) -> PolicyWiring:
    return PolicyWiring(joint_names, loaded.contract, loaded.reference, loaded.extern, action_limit=_NO_LIMIT)


def value_name(wiring: PolicyWiring, i: int) -> str:
    """Return the name of an observation's value: its term and place, and its joint."""
    located = wiring.layout.locate(i)
    joints = value_names(wiring.layout.term_at(i).term, wiring.contract)
    place = int(located.partition("[")[2].partition("]")[0])
    return f"{located} ({joints[place]})" if place < len(joints) else located


def _compare(samples: Trace, kind: str, values: npt.NDArray[np.floating], names: Sequence[str]) -> None:
    """Raise `FieldError` with the first value, shape (S, width), that is too far off the samples' own."""
    expected = samples.arrays[kind]
    if values.shape != expected.shape:
        raise FieldError(f"hold {kind}s of {expected.shape[-1]} values, the contract makes {values.shape[-1]}")
    with np.errstate(invalid="ignore"):  # infinity - infinity
        far = ~(np.abs(values - expected) <= _TOLERANCES[kind] * np.maximum(1.0, np.abs(expected)))
    if far.any():
        i, index = np.argwhere(far)[0].tolist()
        rounded = ", or action_scale was rounded in export: x.contract.yaml can hold it" if kind == "target" else ""
        raise FieldError(
            f"sample {i} of {samples.name}: {kind} {names[index]} is {values[i, index]:.6g}, the trainer's is "
            f"{expected[i, index]:.6g} ({far[i].sum()} of {len(names)} values differ): the policy is wired differently "
            f"here than where it was trained{rounded}"
        )


# --- as one line of JSON ---


def encode_samples(samples: Trace) -> str:
    """Return one line of JSON from which `stored_samples` makes the same samples, bit for bit."""
    arrays = {
        name: {"shape": array.shape, "data": base64.b64encode(array.astype(_type(name)).tobytes()).decode()}
        for name, array in samples.arrays.items()
    }
    document = {"version": _VERSION, "origin": "trainer", "source": samples.name, "joint_names": samples.joint_names}
    return json.dumps({**document, "frame_count": samples.frame_count, "arrays": arrays})


def stored_samples(checkpoint: Checkpoint) -> Trace | None:
    """Return a trainer's samples in a checkpoint's metadata; None without any. Raises `InputError` if malformed."""
    if GOLDEN_KEY not in checkpoint.metadata:
        return None
    malformed = (LookupError, TypeError, ValueError, AttributeError)
    with blaming(f"{checkpoint.source}: golden vectors are malformed, stamp it again", malformed):
        document = json.loads(checkpoint.metadata[GOLDEN_KEY])
        if document["version"] != _VERSION:
            raise ValueError(f"version is {document['version']!r}, expected {_VERSION}")
        arrays = {name: _decoded(name, value) for name, value in document["arrays"].items()}
        missing = {*STATE_ARRAYS, "observation", "action", "last_action", "frame"} - arrays.keys()
        if missing or len({len(array) for array in arrays.values()}) != 1 or not len(arrays["action"]):
            raise ValueError(f"lack {', '.join(sorted(missing)) or 'samples'}")
        joints = tuple(map(str, document["joint_names"]))
        return Trace(str(document["source"]), joints, arrays, int(document["frame_count"]))


def _type(name: str) -> str:
    if name == "frame":
        return "<i8"
    return "<f4" if name in _FLOAT32 or name.startswith(REFERENCE) else "<f8"


def _decoded(name: str, value: Any) -> npt.NDArray[Any]:
    data = base64.b64decode(value["data"], validate=True)
    return np.frombuffer(data, dtype=_type(name)).reshape(value["shape"])  # read-only, as the bytes are
