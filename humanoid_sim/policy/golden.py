"""Golden vectors: a few steps of a trainer's run in a checkpoint's metadata, computed again at every load."""

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
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.layers import MALFORMED
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.readers.own import GOLDEN_KEY
from humanoid_sim.policy.traces import REFERENCE, Trace, array_type

_SAMPLES = 8
_TOLERANCES = {"observation": 1e-4, "action": 1e-3, "target": 1e-4}
"""Absolute for values up to 1, relative beyond; targets in rad. float32 sums in another order stay below, wrong wiring
does not; networks amplify the rounding of other hardware."""
_VERSION = 1


def trainer_samples(checkpoint: Checkpoint, trace: Trace, motion: Motion | None = None) -> Trace:
    """Return samples of a trainer's run, which followed `motion`, after every step has been computed again."""
    loaded = checkpoint.with_motion(motion)
    with blaming(checkpoint.source, (FieldError, ValueError)):
        memories = _verify(loaded, trace)
    chosen = np.unique(np.linspace(0, len(trace) - 1, _SAMPLES).round().astype(np.intp))
    arrays = {name: array[chosen] for name, array in trace.arrays.items()}
    kept = [memories[i] for i in chosen]
    for name in ("last_action", "frame", "walked"):
        arrays[name] = np.array([getattr(memory, name) for memory in kept], dtype=array_type(name))
    alignments = [memory.alignment for memory in kept]
    arrays["alignment"] = np.stack([np.full(7, np.nan) if a is None else np.r_[a.offset, a.yaw] for a in alignments])
    if memories[-1].history is not None:
        none = np.full_like(memories[-1].history, np.nan)
        arrays["history"] = np.stack([none if memory.history is None else memory.history for memory in kept])
    reference = loaded.reference
    if checkpoint.motion is None:
        arrays |= {REFERENCE + name: reference.term(name, arrays["frame"]) for name in reference.terms}
    return replace(trace, arrays=arrays, frame_count=reference.frame_count)


def verify_golden(checkpoint: Checkpoint) -> str:
    """Check a checkpoint against its golden vectors, and return what they are worth in words; '' without any."""
    samples = stored_samples(checkpoint)
    if samples is None:
        return ""
    tables: dict[str, Any] = {}
    with blaming(f"{checkpoint.source}: golden vectors", (FieldError, *MALFORMED)):
        for name, rows in samples.under(REFERENCE).items():
            tables[name] = np.zeros((samples.frame_count, rows.shape[1]), dtype=np.float32)
            tables[name][samples.arrays["frame"]] = rows
        loaded = LoadedPolicy(checkpoint.contract, MotionReference(samples.frame_count, tables), checkpoint.policy)
        _verify(loaded if tables else checkpoint.with_motion(), samples)
    return samples_label(samples)


def samples_label(samples: Trace) -> str:
    """Return what samples are worth, in words."""
    unproved = "" if "target" in samples.arrays else "; without joint targets, so scale and offset are not proved"
    return f"{len(samples)} samples of the trainer's run ({samples.name}){unproved}"


def _verify(loaded: LoadedPolicy, trace: Trace) -> list[PolicyMemory]:
    wiring = PolicyWiring(trace.joint_names, loaded.contract, loaded.reference, loaded.extern)
    arrays, seen, memories = trace.arrays, [], []
    memory = wiring.activate(trace.state(0))
    for i, action in enumerate(arrays["action"]):
        memories.append(trace.memory(i, memory))
        observation, observed = wiring.observe(memories[i], trace.state(i))
        seen.append(observation)
        memory, _ = wiring.act(observed, action)
    _compare(trace, "observation", np.stack(seen), [value_name(wiring, i) for i in range(wiring.layout.width)])
    frames = [int(one.frame) for one in memories]
    with blaming("the model fails on a sample", Exception, FieldError):  # the policy is foreign code
        answers = [loaded.policy(row, frame) for row, frame in zip(arrays["observation"], frames, strict=True)]
    _compare(trace, "action", np.asarray(answers), [f"of {name}" for name in loaded.contract.action_joint_names])
    if "target" in arrays:
        position = action_command(wiring.action_map, arrays["action"]).position
        _compare(trace, "target", position, [f"of {name}" for name in trace.joint_names])
    return memories


def value_name(wiring: PolicyWiring, i: int) -> str:
    """Return the name of an observation's value: its term and place, and its joint."""
    located = wiring.layout.locate(i)
    joints = value_names(wiring.layout.term_at(i).term, wiring.contract)
    place = int(located.partition("[")[2].partition("]")[0])
    return f"{located} ({joints[place]})" if place < len(joints) else located


def _compare(trace: Trace, kind: str, values: npt.NDArray[np.floating], names: Sequence[str]) -> None:
    expected = trace.arrays[kind]
    if values.shape != expected.shape:
        raise FieldError(f"hold {kind}s of {expected.shape[-1]} values, the contract makes {values.shape[-1]}")
    with np.errstate(invalid="ignore"):  # infinity - infinity
        far = ~(np.abs(values - expected) <= _TOLERANCES[kind] * np.maximum(1.0, np.abs(expected)))
    if far.any():
        i, index = np.argwhere(far)[0].tolist()
        raise FieldError(
            f"sample {i} of {trace.name}: {kind} {names[index]} is {values[i, index]:.6g}, the trainer's is "
            f"{expected[i, index]:.6g} ({far[i].sum()} of {len(names)} values differ): the policy is wired differently "
            f"here than where it was trained"
        )


def encode_samples(samples: Trace) -> str:
    """Return one line of JSON from which `stored_samples` makes the same samples, bit for bit."""
    arrays = {
        name: {"shape": array.shape, "data": base64.b64encode(array.astype(array_type(name)).tobytes()).decode()}
        for name, array in samples.arrays.items()
    }
    document = {"version": _VERSION, "origin": "trainer", "source": samples.name, "joint_names": samples.joint_names}
    return json.dumps({**document, "frame_count": samples.frame_count, "arrays": arrays})


def stored_samples(checkpoint: Checkpoint) -> Trace | None:
    """Return a trainer's samples in a checkpoint's metadata; None without any. Raises `InputError` if malformed."""
    if GOLDEN_KEY not in checkpoint.metadata:
        return None
    with blaming(f"{checkpoint.source}: golden vectors are malformed, stamp it again", MALFORMED):
        document = json.loads(checkpoint.metadata[GOLDEN_KEY])
        if document["version"] != _VERSION:
            raise ValueError(f"version is {document['version']!r}, expected {_VERSION}")
        arrays = {name: _decoded(name, value) for name, value in document["arrays"].items()}
        return Trace(document["source"], tuple(document["joint_names"]), arrays, document["frame_count"])


def _decoded(name: str, value: Any) -> npt.NDArray[Any]:
    data = base64.b64decode(value["data"], validate=True)
    return np.frombuffer(data, dtype=array_type(name)).reshape(value["shape"])  # read-only, as the bytes are
