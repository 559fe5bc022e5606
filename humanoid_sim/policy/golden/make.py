"""Make golden vectors of a trainer's trace, or with the program's own wiring, and say what they cannot show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from humanoid_sim import mit
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import PolicyMemory, action_command, resolve_action
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.messages import PolicyStep
from humanoid_sim.mit import Float32Array, FloatArray, point_velocity
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.golden.samples import GoldenSamples
from humanoid_sim.policy.golden.trace import Trace
from humanoid_sim.policy.golden.verify import golden_problem, memory_fields, observe, recorded_wiring, samples_wiring
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion

SAMPLE_COUNT = 8
_OWN_STEPS = 64
"""Steps of a made-up run, long enough to fill any usual history."""


class _Row(NamedTuple):
    """One step: with what it was entered, and what the policy saw."""

    memory: PolicyMemory
    step: PolicyStep


def trainer_samples(checkpoint: Checkpoint, trace: Trace, motion: Motion | None = None) -> GoldenSamples:
    """Return samples of a trainer's run, spread evenly over it, after every step of it has been computed again.

    Raises `InputError` if the checkpoint's observation, action or targets differ from the trainer's; the line names the
    first step, term and joint, and both values.

    Args:
        motion: what the run followed, where the model does not carry it.
    """
    loaded = checkpoint.following(motion)
    whole = _samples(checkpoint, loaded, trace, _rolled(checkpoint, loaded, trace))
    assert trace.observation is not None  # a file has it
    whole = replace(whole, origin="trainer", source=trace.name, observation=trace.observation)
    if trace.target is not None:
        whole = replace(whole, target=trace.target, target_origin="trainer")
    problem = golden_problem(checkpoint, whole)
    if problem:
        raise InputError(f"{checkpoint.source}: {problem}")
    return _pick(whole, SAMPLE_COUNT)


def own_samples(checkpoint: Checkpoint, motion: Motion | None = None, count: int = SAMPLE_COUNT) -> GoldenSamples:
    """Return samples of made-up states, with the observation and the action as this program makes them: drift only.

    Raises `InputError` if the policy does not run on them.
    """
    loaded = checkpoint.following(motion)
    made_up = _made_up(checkpoint, loaded)
    rows = _rolled(checkpoint, loaded, made_up)
    answers = [checkpoint.policy(row.step.observation, row.step.frame) for row in rows]
    whole = _samples(checkpoint, loaded, replace(made_up, action=np.asarray(answers, dtype=np.float32)), rows)
    return _pick(whole, count)


def _rolled(checkpoint: Checkpoint, loaded: LoadedPolicy, trace: Trace) -> list[_Row]:
    """Go through a run from activation on."""
    rows: list[_Row] = []
    where = ""
    try:
        wiring = recorded_wiring(loaded, trace.joint_names)
        memory = wiring.activate(trace.state(0))
        for k, action in enumerate(trace.action):
            where = f"step {k}: "
            entered = replace(memory, **memory_fields({name: table[k] for name, table in trace.memory.items()}))
            step, observed = observe(wiring, entered, trace.state(k), action)
            rows.append(_Row(entered, step))
            memory, _ = wiring.act(observed, action)
    except (FieldError, ValueError) as error:
        raise InputError(f"{checkpoint.source}: on {trace.name}: {where}{error}") from None
    return rows


def _samples(checkpoint: Checkpoint, loaded: LoadedPolicy, trace: Trace, rows: list[_Row]) -> GoldenSamples:
    state: dict[str, Any] = dict(trace.arrays)
    reference = loaded.reference
    frames = np.array([row.step.frame for row in rows], dtype=np.int64)
    tables = {} if checkpoint.motion is not None else dict(reference.terms)
    action_map = resolve_action(checkpoint.contract, trace.joint_names)
    return GoldenSamples(
        origin="own",
        source="",
        joint_names=trace.joint_names,
        **state,
        last_action=np.stack([row.memory.last_action for row in rows]),
        frame=frames,
        walked=np.array([row.memory.walked for row in rows]),
        alignment=np.stack([_alignment(row.memory) for row in rows]),
        observation=np.stack([row.step.observation for row in rows]),
        action=trace.action,
        target=action_command(action_map, trace.action).position,
        extern=trace.extern,
        history=_histories(rows),
        reference={name: np.asarray(table[reference.clamp(frames)]) for name, table in tables.items()},
        frame_count=reference.frame_count,
    )


def _histories(rows: list[_Row]) -> Float32Array | None:
    """Shape (S, h, w); NaN where there was no step before. None for a policy that shows only the present."""
    known = next((row.memory.history for row in rows if row.memory.history is not None), None)
    if known is None:
        return None
    missing = np.full_like(known, np.nan)
    return np.stack([missing if row.memory.history is None else row.memory.history for row in rows])


def _alignment(memory: PolicyMemory) -> FloatArray:
    laid = memory.alignment
    return np.full(7, np.nan) if laid is None else np.concatenate([laid.offset, laid.yaw])


def _pick(whole: GoldenSamples, count: int) -> GoldenSamples:
    """Return some samples, the first and the last among them."""
    rows = np.unique(np.linspace(0, len(whole) - 1, count).round().astype(int))
    chosen: dict[str, Any] = {}
    for name in GoldenSamples.__slots__:
        value = getattr(whole, name)
        if isinstance(value, np.ndarray):
            chosen[name] = value[rows]
        elif isinstance(value, Mapping):
            chosen[name] = MappingProxyType({key: table[rows] for key, table in value.items()})
    return replace(whole, **chosen)


def _made_up(checkpoint: Checkpoint, loaded: LoadedPolicy) -> Trace:
    """Get steps of a robot that stumbles about its default pose, heading and all else not zero: nothing must cancel."""
    contract, steps = checkpoint.contract, _OWN_STEPS
    rng = np.random.default_rng(0)
    joints = len(contract.joint_names)
    ranges = np.array([[-1.0, 1.0]] * 3) if contract.command_ranges is None else contract.command_ranges
    arrays = {
        "joint_position": contract.default_joint_pos + rng.normal(0.0, 0.2, (steps, joints)),
        "joint_velocity": rng.normal(0.0, 1.0, (steps, joints)),
    }
    quaternion = np.array([0.5, 0.1, -0.1, 0.8]) + rng.normal(0.0, 0.05, (steps, 4))
    quaternion /= np.sqrt((quaternion**2).sum(axis=1, keepdims=True))
    arrays |= {
        "imu_quaternion": quaternion,
        "imu_angular_velocity": rng.normal(0.0, 0.5, (steps, 3)),
        "imu_linear_acceleration": np.array([0.0, 0.0, 9.81]) + rng.normal(0.0, 1.0, (steps, 3)),
    }
    live = {
        mit.VELOCITY_COMMAND: rng.uniform(ranges[:, 0], ranges[:, 1], (steps, 3)),
        mit.BASE_LINEAR_VELOCITY: rng.normal(0.0, 0.5, (steps, 3)),
        mit.ANCHOR_POSE: np.concatenate([rng.normal([1.0, 2.0, 0.8], 0.1, (steps, 3)), quaternion], axis=1),
    }
    for point in contract.velocity_points:
        live[point_velocity(point)] = rng.normal(0.0, 0.5, (steps, 3))
    if contract.height_scan is not None:
        live[mit.HEIGHT_SCAN] = rng.uniform(0.0, 1.0, (steps, contract.height_scan.count))
    keys = loaded.extern.get(mit.KEY_PRESSED)
    if keys is not None:
        live[mit.KEY_PRESSED] = rng.integers(0, 2, (steps, keys)).astype(np.float64)
    actions = rng.normal(0.0, 0.5, (steps, contract.action_count)).astype(np.float32)
    return Trace("made-up states", contract.joint_names, arrays, live, actions)


_ZERO = 1e-6
"""Magnitude below which a term says nothing about its scale or its sign."""


def blind_spots(checkpoint: Checkpoint, samples: GoldenSamples) -> tuple[str, ...]:
    """Conventions that could be wrong without a difference in the samples, one line each.

    Every convention of every term is turned round in the contract, and the samples computed again: what still fits is
    not seen. The samples must fit the checkpoint as it is.
    """
    unseen = [
        what
        for what, contract in _mistakes(checkpoint.contract)
        if not golden_problem(replace(checkpoint, contract=contract), samples)
    ]
    unseen += _silent_terms(checkpoint, samples)
    if samples.target_origin == "own":
        unseen.append("action scale, offset and clip: the samples hold no targets of the trainer's")
    if not np.isnan(samples.alignment).all():
        unseen.append("align_reference: the samples hold the alignment itself")
    return (*unseen, "joint_stiffness, joint_damping and policy_dt: nothing in a sample depends on them")


def _mistakes(contract: PolicyContract) -> Iterator[tuple[str, PolicyContract]]:
    terms = contract.terms
    for i, term in enumerate(terms):
        for what, changes in _turned(term, contract):
            observation = (*terms[:i], replace(term, **changes), *terms[i + 1 :])
            yield f"{term.name}: {what}", replace(contract, observation=observation)


def _turned(term: Term, contract: PolicyContract) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the other choices of each convention that matters for the term."""
    kind = contract.kind(term)
    for convention in kind.conventions:
        if convention == "sign":
            continue  # a sign is not seen only where the term is silent
        if convention == "relative":
            relative = kind.is_relative(term)
            yield f"{'relative' if relative else 'absolute'} positions", {"relative": not relative}
        elif convention == "inverse":
            yield "direction of the rotation", {"inverse": not term.inverse}
        else:
            now, others = getattr(term, convention), term.others(convention)
            for other in others:
                instead = f", not {other}" if len(others) > 1 else ""
                title = "order" if convention == "quaternion" else convention
                yield f"{title} ({now}{instead})", {convention: other}
    if term.history > 1 and contract.history_layout == "per_term":
        (other,) = term.others("history_order")
        yield f"history order ({term.history_order})", {"history_order": other}


def _silent_terms(checkpoint: Checkpoint, samples: GoldenSamples) -> list[str]:
    layout = samples_wiring(checkpoint, samples).layout
    owner = np.array([layout.locate(i).partition("[")[0] for i in range(layout.width)])
    silent = (np.abs(samples.observation) <= _ZERO).all(axis=0)
    return [
        f"{term.name}: scale and sign, it is zero in all samples"
        for term in layout.terms
        if np.all(silent, where=owner == term.name)
    ]
