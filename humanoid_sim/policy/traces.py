"""A trainer's run: what the robot did, what the policy saw, what it answered; read from a file and computed again.

A few steps of it, the golden vectors in a checkpoint's metadata, are computed again at every load.
`docs/golden-vectors.md` lists the arrays of the `.npz` file, one row per policy step, from activation on.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim import mit
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import PolicyMemory, PolicyWiring, action_command
from humanoid_sim.controllers.reference import Alignment, MotionReference
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.errors import FieldError, blaming
from humanoid_sim.files import read_arrays
from humanoid_sim.mit import Extern, Float32Array, FloatArray, MITState
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.layers import MALFORMED
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.readers.own import GOLDEN_KEY

Arrays = Mapping[str, npt.NDArray[Any]]
Floats = npt.NDArray[np.floating]
BodyReader = Callable[[FloatArray, FloatArray, tuple[str, ...]], Mapping[str, FloatArray]]
"""`(qpos (F, nq), qvel (F, nv), names of its joints) -> arrays` of what a robot's model knows beside its joints."""

STATE_ARRAYS = (
    *("joint_position", "joint_velocity"),
    *("imu_quaternion", "imu_angular_velocity", "imu_linear_acceleration"),
)
"""What the robot reports, apart from the live inputs."""
EXTERN, REFERENCE = "extern/", "reference/"  # prefixes of the names of live inputs, and of the motion's terms
_NAMES = {"obs": "observation", "actions": "action", "cmd": mit.VELOCITY_COMMAND}
_MEMORY = ("last_action", "frame", "walked", "history", "alignment")
_FLOAT32 = ("last_action", "observation", "action", "history")
_SAMPLES = 8
_TOLERANCES = {"observation": 1e-4, "action": 1e-3, "target": 1e-4}
"""Absolute for values up to 1, relative beyond; targets in rad. float32 sums in another order stay below, wrong wiring
does not; networks amplify the rounding of other hardware."""
_ROUNDING = 0.5e-3  # largest error of an action scale or offset with three decimals
_VERSION = 1


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """S policy steps of a run."""

    name: str  # of the file
    joint_names: tuple[str, ...]  # the J joints of the states, in the robot's order
    arrays: Arrays
    """By name, S rows each: `STATE_ARRAYS` (rad, rad/s, w x y z, m/s²); `extern/NAME` of each live input; `observation`
    and `action`, raw; `target`, rad, where the trainer's is known. Of the policy's memory, as far as it is known:
    `last_action`, `frame`, `walked` (rad of gait phase), `history` (S, steps, width) oldest first, `alignment` (S, 7),
    the motion's world in the robot's; NaN where there is none. `reference/NAME`: rows of the motion at `frame`, for a
    model that does not carry it."""
    frame_count: int = 1  # of that motion

    def __len__(self) -> int:
        return len(self.arrays["action"])

    def under(self, prefix: str) -> Arrays:
        """Return the arrays of live inputs, or of the motion, by their own names."""
        return {name.removeprefix(prefix): array for name, array in self.arrays.items() if name.startswith(prefix)}

    def state(self, i: int) -> MITState:
        """Return what the robot reported in step i; efforts are not recorded."""
        zeros = np.zeros(len(self.joint_names))
        extern = {name: Extern(array[i], 0.0) for name, array in self.under(EXTERN).items()}
        rows = {name: self.arrays[name][i] for name in STATE_ARRAYS}
        return MITState(time=0.0, **rows, joint_effort=zeros, joint_age=zeros, extern=extern)

    def memory(self, i: int, memory: PolicyMemory) -> PolicyMemory:
        """Return a policy's memory with what is known of it in step i."""
        known: dict[str, Any] = {name: self.arrays[name][i] for name in _MEMORY if name in self.arrays}
        known |= {name: None for name in ("history", "alignment") if np.isnan(known.get(name, 0.0)).any()}
        if known.get("alignment") is not None:
            known["alignment"] = Alignment(yaw=known["alignment"][3:], offset=known["alignment"][:3])
        return replace(memory, **known)


def array_type(name: str) -> str:
    """Return the type of an array of a `Trace`, as NumPy names it."""
    if name == "frame":
        return "<i8"
    return "<f4" if name in _FLOAT32 or name.startswith(REFERENCE) else "<f8"


def read_trace(path: Path, contract: PolicyContract, bodies: BodyReader | None = None) -> Trace:
    """Read a trace for a policy, without joints that it lacks; `bodies` is of the trace's robot, for `qpos`."""
    given = {_NAMES.get(name, name): array for name, array in read_arrays(path).items()}
    with blaming(path, (FieldError, ValueError)):
        return _trace(path.name, given, contract, bodies)


def _trace(name: str, given: Arrays, contract: PolicyContract, bodies: BodyReader | None) -> Trace:
    if "action" not in given or "joint_names" not in given or not given["action"].size:
        raise FieldError(f"has {', '.join(given)}, expected joint_names, and action with a row for each step")
    steps, names = len(given["action"]), tuple(given["joint_names"].astype(str).tolist())
    # A free joint has 7 values, and any other 1; it has a name of its own, or none.
    surplus = given["qpos"].shape[-1] - len(names) if "qpos" in given else 0
    hinges, free = names[1:] if surplus == 6 else names, 7 if surplus in (6, 7) else 0
    count = len(hinges)
    missing = [joint for joint in contract.joint_names if joint not in hinges]
    if missing:
        raise FieldError(f"joint_names lacks {', '.join(missing)}, expected every joint of the policy")
    if "qpos" in given:
        if bodies is None:
            raise FieldError("qpos needs the trainer's robot, whose model says where its IMU is: --robot")
        qpos = _table(given, "qpos", steps, free + count)
        qvel = _table(given, "qvel", steps, max(free - 1, 0) + count)
        joints = {"joint_position": qpos[:, free:], "joint_velocity": qvel[:, max(free - 1, 0) :]}
        given = {**joints, **bodies(qpos, qvel, hinges), **given}  # what the file says itself counts
    given = {"imu_linear_acceleration": np.zeros((steps, 3)), **given}
    observed = {contract.kind(term).input(term) for term in contract.terms}
    widths: dict[str, int | None] = dict(zip(STATE_ARRAYS, (count, count, 4, 3, 3), strict=True))
    widths |= {"observation": None, "action": contract.action_count}
    widths |= {"target": count} if "target" in given else {}
    arrays: dict[str, npt.NDArray[Any]] = {key: _table(given, key, steps, width) for key, width in widths.items()}
    for key, width in {**contract.extern_widths, mit.KEY_PRESSED: None}.items():
        if key in given or key in observed:
            arrays[EXTERN + key] = _table(given, key, steps, width)
    columns = [i for i, joint in enumerate(hinges) if joint in contract.joint_names]
    for key in {"joint_position", "joint_velocity", "target"} & arrays.keys():
        arrays[key] = arrays[key][:, columns]
    for key in given.keys() & {"frame", "alignment"}:
        arrays[key] = np.broadcast_to(given[key], (steps, 7)) if given[key].shape == (7,) else given[key]
        if len(np.atleast_1d(arrays[key])) != steps:
            raise FieldError(f"{key} has shape {arrays[key].shape}, expected {steps} rows")
    typed = {key: array.astype(array_type(key)) for key, array in arrays.items()}
    return Trace(name, tuple(hinges[i] for i in columns), typed)


def _table(arrays: Arrays, name: str, steps: int, width: int | None) -> FloatArray:
    if name not in arrays:
        there = ", ".join(arrays)
        raise FieldError(f"{name} is missing, expected a row for each step, or qpos and --robot; the file has {there}")
    values: FloatArray = arrays[name].astype(np.float64)
    if values.ndim == 1 and len(values) == width:
        values = np.broadcast_to(values, (steps, width))
    if values.ndim != 2 or len(values) != steps or width not in (None, values.shape[1]):
        raise FieldError(f"{name} has shape {values.shape}, expected ({steps}, {width or 'width'})")
    if not np.isfinite(values).all():
        raise FieldError(f"{name} is not finite in row {int(np.argmax(~np.isfinite(values).all(axis=1)))}")
    return values


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
    arrays, steps = trace.arrays, list(replayed(wiring, trace))
    memories, seen = [memory for memory, _ in steps], [observation for _, observation in steps]
    _compare(trace, "observation", np.stack(seen), [value_name(wiring, i) for i in range(wiring.layout.width)])
    frames = [int(one.frame) for one in memories]
    with blaming("the model fails on a sample", Exception, FieldError):  # the policy is foreign code
        answers = [loaded.policy(row, frame) for row, frame in zip(arrays["observation"], frames, strict=True)]
    _compare(trace, "action", np.asarray(answers), [f"of {name}" for name in loaded.contract.action_joint_names])
    if "target" in arrays:
        position = action_command(wiring.action_map, arrays["action"]).position
        _compare(trace, "target", position, [f"of {name}" for name in trace.joint_names])
    return memories


def replayed(wiring: PolicyWiring, trace: Trace) -> Iterator[tuple[PolicyMemory, Float32Array]]:
    """Yield the policy's memory before each step, with what is known of it, and its observation, shape (N,)."""
    memory = wiring.activate(trace.state(0))
    for i, action in enumerate(trace.arrays["action"]):
        known = trace.memory(i, memory)
        observation, observed = wiring.observe(known, trace.state(i))
        yield known, observation
        memory, _ = wiring.act(observed, action)


def value_name(wiring: PolicyWiring, i: int) -> str:
    """Return the name of an observation's value: its term and place, and its joint."""
    located = wiring.layout.locate(i)
    joints = value_names(wiring.layout.term_at(i).term, wiring.contract)
    place = int(located.partition("[")[2].partition("]")[0])
    return f"{located} ({joints[place]})" if place < len(joints) else located


def _compare(trace: Trace, kind: str, values: Floats, names: Sequence[str]) -> None:
    expected = trace.arrays[kind]
    if values.shape != expected.shape:
        raise FieldError(f"hold {kind}s of {expected.shape[-1]} values, the contract makes {values.shape[-1]}")
    far = far_values(kind, values, expected)
    if far.any():
        i, index = np.argwhere(far)[0].tolist()
        is_rounded = kind == "target" and is_rounding(values, expected, trace.arrays["action"])
        why = ", or action_scale was rounded in export: env.yaml or x.contract.yaml can hold it" if is_rounded else ""
        raise FieldError(
            f"sample {i} of {trace.name}: {kind} {names[index]} is {values[i, index]:.6g}, the trainer's is "
            f"{expected[i, index]:.6g} ({far[i].sum()} of {len(names)} values differ): the policy is wired differently "
            f"here than where it was trained{why}"
        )


def far_values(kind: str, values: Floats, expected: Floats) -> mit.BoolArray:
    """Return which observations, actions or targets are not those expected, but for rounding."""
    with np.errstate(invalid="ignore"):  # infinity - infinity
        return np.asarray(~(np.abs(values - expected) <= _TOLERANCES[kind] * np.maximum(1.0, np.abs(expected))))


def is_rounding(position: Floats, target: Floats, actions: Floats) -> bool:
    """Return True if joint targets, rad, differ by no more than a scale and an offset with three decimals explain."""
    return bool(np.abs(position - target).max() <= _ROUNDING * (1.0 + np.abs(actions).max()))


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
