"""Compute a checkpoint's golden vectors again, and refuse it if something else comes out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.controllers.policy_step import Policy, PolicyMemory, PolicyWiring, action_command
from humanoid_sim.controllers.reference import Alignment, MotionReference
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import is_file
from humanoid_sim.messages import PolicyStep
from humanoid_sim.mit import Float32Array, FloatArray, MITState
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.golden.samples import GOLDEN_KEY, GoldenSamples, decode_samples
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.onnx_policy import OnnxPolicy, external_file

OBSERVATION_TOLERANCE = 1e-4
"""Absolute for values up to 1, relative beyond: float32 sums in another order stay below, wrong wiring does not."""
ACTION_TOLERANCE = 1e-3
"""Likewise of the raw action; networks amplify the rounding of other hardware."""
TARGET_TOLERANCE = 1e-4
"""Likewise of the commanded positions, in rad."""

_EXPORTERS_ROUNDING = 0.5e-3
"""Largest error of an action scale or offset with three decimals."""
_NO_LIMIT = 1e9
"""A recorded action is what it is."""
_SHOWN = 4
"""Names of terms or joints in one message."""


def verify_golden(checkpoint: Checkpoint) -> str:
    """Check a checkpoint against its golden vectors, and return what they are worth in words; '' without any.

    Raises `InputError` with the first sample, term and joint that differ, and both values; or for malformed samples.
    """
    if GOLDEN_KEY not in checkpoint.metadata:
        return ""
    samples = decode_samples(checkpoint.metadata[GOLDEN_KEY], checkpoint.source)
    problem = golden_problem(checkpoint, samples)
    if problem:
        raise InputError(f"{checkpoint.source}: golden vectors: {problem}")
    return samples.label


def golden_problem(checkpoint: Checkpoint, samples: GoldenSamples) -> str:
    """Return what differs between the samples and what the checkpoint makes of their states, '' if nothing does.

    The observation and the targets are computed by the functions that run on the robot, the action by the model from
    the sample's observation.
    """
    contract = checkpoint.contract
    try:
        wiring = samples_wiring(checkpoint, samples)
    except (FieldError, InputError) as error:
        return f"cannot be computed: {str(error).removeprefix(f'{checkpoint.source}: ')}"
    return (
        _width_problem(wiring, samples)
        or _observation_problem(wiring, samples)
        or _action_problem(checkpoint.policy, contract, samples)
        or _target_problem(wiring, samples)
    )


def _width_problem(wiring: PolicyWiring, samples: GoldenSamples) -> str:
    width, actions = wiring.layout.width, wiring.contract.action_count
    if samples.observation.shape[1] != width:
        return f"hold observations of {samples.observation.shape[1]} values, the contract's terms make {width}"
    if samples.action.shape[1] != actions:
        return f"hold actions of {samples.action.shape[1]} values, the contract has {actions}"
    return ""


def _observation_problem(wiring: PolicyWiring, samples: GoldenSamples) -> str:
    layout, contract = wiring.layout, wiring.contract
    observation = np.empty_like(samples.observation)
    for i in range(len(samples)):
        try:
            step, _ = observe(wiring, _memory(samples, i), samples.state(i), samples.action[i])
        except (FieldError, ValueError) as error:
            return f"sample {i} cannot be computed: {error}"
        observation[i] = step.observation
    names = [layout.locate(i).partition("[")[0] for i in range(layout.width)]
    return _difference(
        samples, "observation", observation, OBSERVATION_TOLERANCE, names, lambda i: value_name(layout, contract, i)
    )


def _action_problem(policy: Policy, contract: PolicyContract, samples: GoldenSamples) -> str:
    try:
        answers = [
            policy(observation, int(frame))
            for observation, frame in zip(samples.observation, samples.frame, strict=True)
        ]
    except Exception as error:  # the policy is foreign code
        return f"the model fails on a sample: {str(error).partition(chr(10))[0]}"
    joints = contract.action_joint_names
    told = _difference(samples, "action", np.asarray(answers), ACTION_TOLERANCE, joints)
    beside = external_file(policy.model.path) if isinstance(policy, OnnxPolicy) else None
    if not told or beside is None or not is_file(beside):
        return told
    return f"{told}, or its tensors in {beside.name} are another model's"


def _target_problem(wiring: PolicyWiring, samples: GoldenSamples) -> str:
    position = action_command(wiring.action_map, samples.action).position
    told = _difference(samples, "target", position, TARGET_TOLERANCE, samples.joint_names)
    rounding = _EXPORTERS_ROUNDING * (1.0 + np.abs(samples.action).max())
    if not told or (np.abs(position - samples.target) > rounding).any():
        return told
    return f"{told}, or only rounded by its exporter: x.contract.yaml can hold the trainer's own action_scale"


def samples_wiring(checkpoint: Checkpoint, samples: GoldenSamples) -> PolicyWiring:
    """Return the wiring that computes the samples again, with their own rows of the motion if they hold any.

    Raises:
        FieldError, InputError: the contract does not fit the samples' joints, or a term lacks its source.
    """
    if samples.reference:
        tables = {}
        for name, rows in samples.reference.items():
            table = np.zeros((samples.frame_count, rows.shape[1]), dtype=np.float32)
            table[samples.frame] = rows
            tables[name] = table
        reference = MotionReference(samples.frame_count, tables)
        loaded = LoadedPolicy(checkpoint.contract, reference, checkpoint.policy)
    else:
        loaded = checkpoint.following()
    return recorded_wiring(loaded, samples.joint_names)


def recorded_wiring(loaded: LoadedPolicy, joint_names: tuple[str, ...]) -> PolicyWiring:
    """Return the wiring of a policy whose actions are those of a run.

    Raises `FieldError` if the contract does not fit the joints, or a term lacks its source.
    """
    return PolicyWiring(joint_names, loaded.contract, loaded.reference, loaded.extern, action_limit=_NO_LIMIT)


def observe(
    wiring: PolicyWiring, memory: PolicyMemory, state: MITState, action: Float32Array
) -> tuple[PolicyStep, PolicyMemory]:
    """One step whose policy answers `action`, and the memory with its observation.

    Raises `FieldError` if the controller would refuse the observation or the action.
    """
    observation, observed = wiring.observe(memory, state)
    problem = wiring.observation_problem(observation) or wiring.action_problem(action)
    if problem:
        raise FieldError(problem)
    return PolicyStep(int(memory.frame), observation, action), observed


def _memory(samples: GoldenSamples, i: int) -> PolicyMemory:
    """Return what the policy remembered when it met sample i."""
    table: dict[str, npt.NDArray[np.floating | np.integer]] = {
        name: getattr(samples, name) for name in ("last_action", "frame", "walked", "alignment")
    }
    if samples.history is not None:
        table["history"] = samples.history
    return PolicyMemory(**memory_fields({name: values[i] for name, values in table.items()}))


def memory_fields(given: Mapping[str, npt.NDArray[np.floating | np.integer]]) -> dict[str, Any]:
    """Return the recorded memory in its own types; NaN stands for a history or an alignment that is not there."""
    return {name: _MEMORY[name](value) for name, value in given.items()}


def _alignment(values: FloatArray) -> Alignment | None:
    return (
        None
        if np.isnan(values).any()
        else Alignment(yaw=values[3:].astype(np.float64), offset=values[:3].astype(np.float64))
    )


_MEMORY: Mapping[str, Callable[[Any], Any]] = {
    "last_action": lambda values: values.astype(np.float32),
    "frame": int,
    "walked": float,
    "history": lambda values: None if np.isnan(values).any() else values.astype(np.float32),
    "alignment": _alignment,
}


def value_name(layout: ObservationLayout, contract: PolicyContract, index: int) -> str:
    """Return the value at `index` of the whole observation, and its joint: `joint_pos[3] (left_knee_joint)`."""
    located = layout.locate(index)
    name, _, rest = located.partition("[")
    place = int(rest.partition("]")[0])
    term = next(term for term in layout.terms if term.name == name)
    joints = contract.kind(term.term).value_names(term.term, contract)
    return f"{located} ({joints[place]})" if place < len(joints) else located


def _difference(
    samples: GoldenSamples,
    kind: Literal["observation", "action", "target"],
    value: npt.NDArray[np.floating],
    tolerance: float,
    names: Sequence[str],
    what: Callable[[int], str] | None = None,
) -> str:
    """Return what is too far off the samples' own, '' if nothing is.

    Args:
        samples: with the array `kind`, (S, width), that is expected.
        value: shape (S, width).
        tolerance: absolute up to 1, relative beyond.
        names: term or joint of each column.
        what: names a column; None: by its joint.
    """
    expected: npt.NDArray[np.floating] = getattr(samples, kind)
    with np.errstate(invalid="ignore"):  # infinity - infinity
        far = ~(np.abs(value - expected) <= tolerance * np.maximum(1.0, np.abs(expected)))
    if not far.any():
        return ""
    i = int(np.argmax(far.any(axis=1)))
    index = int(np.argmax(far[i]))
    touched = list(dict.fromkeys(name for name, hit in zip(names, far.any(axis=0), strict=True) if hit))
    shown = ", ".join(touched[:_SHOWN]) + (", …" if len(touched) > _SHOWN else "")
    if (samples.target_origin if kind == "target" else samples.origin) == "trainer":
        whose, verdict = "the trainer's is", "the policy is wired differently here than where it was trained"
    else:
        whose, verdict = "it was", "contract, model or program changed since it was stamped"
    where = f"sample {i}" + (f" of {samples.source}" if samples.source else "")
    place = f"of {names[index]}" if what is None else what(index)
    return (
        f"{where}: {kind} {place} is {value[i, index]:.6g}, {whose} {expected[i, index]:.6g} "
        f"({far[i].sum()} of {len(names)} values differ; in all samples: {shown}): {verdict}"
    )
