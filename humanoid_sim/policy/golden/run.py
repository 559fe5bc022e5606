"""A policy's steps outside a session: on recorded states, its memory set and read step by step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import PolicyMemory, PolicyWiring
from humanoid_sim.controllers.reference import Alignment, MotionReference
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import PolicyStep
from humanoid_sim.mit import Extern, FloatArray, MITState
from humanoid_sim.policy.golden.samples import GoldenSamples

__all__ = ["Recorded", "Row", "observe", "recorded_wiring", "roll", "sample_memory", "sample_state"]

Float32Array = npt.NDArray[np.float32]

_NO_LIMIT = 1e9
"""A recorded action is what it is."""
_NO_EXTERN: Mapping[str, int] = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """The robot's side of a run, F policy steps one after the other from activation on, and what is known beside it."""

    joint_names: tuple[str, ...]
    states: tuple[MITState, ...]
    """F of them."""
    action: Float32Array
    """Shape (F, m), raw."""
    memory: Mapping[str, npt.NDArray[np.floating | np.integer]] = field(default_factory=lambda: MappingProxyType({}))
    """`last_action`, `frame`, `walked`, `history`, `alignment`, one row per step, as far as the source gives them; what
    it does not follows from the steps before."""


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One step: with what it was entered, and what the policy saw."""

    memory: PolicyMemory
    step: PolicyStep


def recorded_wiring(
    contract: PolicyContract,
    joint_names: tuple[str, ...],
    reference: MotionReference,
    extern: Mapping[str, int] = _NO_EXTERN,
) -> PolicyWiring:
    """The wiring of a policy whose actions are those of a run.

    Raises:
        FieldError: if the contract does not fit the joints, or a term lacks its source.
    """
    return PolicyWiring(joint_names, contract, reference, extern, action_limit=_NO_LIMIT)


def roll(wiring: PolicyWiring, recorded: Recorded) -> list[Row]:
    """Go through a run from activation on.

    Raises:
        FieldError: naming the step that the controller would refuse, and why.
    """
    rows: list[Row] = []
    memory = wiring.activate(recorded.states[0])
    for k, (state, action) in enumerate(zip(recorded.states, recorded.action, strict=True)):
        entered = replace(memory, **_memory_fields({name: table[k] for name, table in recorded.memory.items()}))
        try:
            step, observed = observe(wiring, entered, state, action)
        except FieldError as error:
            raise FieldError(f"step {k}: {error}") from None
        rows.append(Row(entered, step))
        memory, _ = wiring.act(observed, action)
    return rows


def observe(
    wiring: PolicyWiring, memory: PolicyMemory, state: MITState, action: Float32Array
) -> tuple[PolicyStep, PolicyMemory]:
    """One step whose policy answers `action`, and the memory with its observation.

    Raises:
        FieldError: if the controller would refuse the observation or the action.
    """
    observation, observed = wiring.observe(memory, state)
    problem = wiring.observation_problem(observation) or wiring.action_problem(action)
    if problem:
        raise FieldError(problem)
    return PolicyStep(int(memory.frame), observation, action), observed


def sample_memory(samples: GoldenSamples, i: int) -> PolicyMemory:
    """What the policy remembered when it met sample i."""
    table: dict[str, npt.NDArray[np.floating | np.integer]] = {
        name: getattr(samples, name) for name in ("last_action", "frame", "walked", "alignment")
    }
    if samples.history is not None:
        table["history"] = samples.history
    return PolicyMemory(**_memory_fields({name: values[i] for name, values in table.items()}))


def sample_state(samples: GoldenSamples, i: int) -> MITState:
    """What the robot reported in sample i."""
    zeros = np.zeros(len(samples.joint_names))
    return MITState(
        time=0.0,
        joint_position=samples.joint_position[i],
        joint_velocity=samples.joint_velocity[i],
        joint_effort=zeros,
        joint_age=zeros,
        imu_quaternion=samples.imu_quaternion[i],
        imu_angular_velocity=samples.imu_angular_velocity[i],
        imu_linear_acceleration=samples.imu_linear_acceleration[i],
        extern={name: Extern(values[i], 0.0) for name, values in samples.extern.items()},
    )


def _memory_fields(given: Mapping[str, npt.NDArray[np.floating | np.integer]]) -> dict[str, Any]:
    """The recorded memory in its own types; NaN stands for a history or an alignment that is not there."""
    fields: dict[str, Any] = {}
    if "last_action" in given:
        fields["last_action"] = np.asarray(given["last_action"], dtype=np.float32)
    if "frame" in given:
        fields["frame"] = int(given["frame"])
    if "walked" in given:
        fields["walked"] = float(given["walked"])
    if "history" in given:
        history = np.asarray(given["history"], dtype=np.float32)
        fields["history"] = None if np.isnan(history).any() else history
    if "alignment" in given:
        fields["alignment"] = _alignment(np.asarray(given["alignment"], dtype=np.float64))
    return fields


def _alignment(values: FloatArray) -> Alignment | None:
    return None if np.isnan(values).any() else Alignment(yaw=values[3:], offset=values[:3])
