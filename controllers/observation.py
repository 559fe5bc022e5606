"""The observation of a policy: terms resolved once, then packed in order without string work.

Environment, player and robot share these functions; they take `(..., n)`, one robot or a batch, and a batch gives bit
for bit what its robots give one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.reference import Frame, MotionReference
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.mit import MITState

__all__ = ["ObservationContext", "ObservationLayout", "ObservationTerm", "joint_indices", "pack", "resolve_observation"]

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class ObservationContext:
    """Everything that a term may read."""

    state: MITState
    last_action: Float32Array
    """Shape (..., m), raw."""
    reference: MotionReference
    frame: Frame
    """Shape (...)."""


Source = Callable[[ObservationContext], Any]


@dataclass(frozen=True, slots=True)
class ObservationTerm:
    """One term: where it goes, and what is read for it."""

    name: str
    start: int
    stop: int
    source: Source

    @property
    def width(self) -> int:
        """Number of values."""
        return self.stop - self.start


@dataclass(frozen=True, slots=True)
class ObservationLayout:
    """The terms of a flat observation in their order."""

    terms: tuple[ObservationTerm, ...]

    @property
    def width(self) -> int:
        """N, the number of values of the whole observation."""
        return self.terms[-1].stop if self.terms else 0

    def locate(self, index: int) -> str:
        """The value at `index` in words: `joint_pos[3]`."""
        term = next(term for term in self.terms if term.start <= index < term.stop)
        return f"{term.name}[{index - term.start}]"


def joint_indices(wanted: tuple[str, ...], available: tuple[str, ...], what: str) -> npt.NDArray[np.intp]:
    """Positions of the `wanted` joints among the `available` ones.

    Raises:
        FieldError: naming the joint that is missing and those that exist.
    """
    place = {name: i for i, name in enumerate(available)}
    for name in wanted:
        if name not in place:
            raise FieldError(f"{known_names('joint', name, available)} ({what})")
    indices = np.array([place[name] for name in wanted], dtype=np.intp)
    indices.setflags(write=False)
    return indices


def resolve_observation(
    contract: PolicyContract, robot_joints: tuple[str, ...], reference: MotionReference, extern: Mapping[str, int]
) -> ObservationLayout:
    """Look every term up once.

    Args:
        contract: names the terms, the joints and the bodies.
        robot_joints: the order of the state's per-joint arrays.
        reference: where the motion terms come from.
        extern: name and width of the live terms.

    Raises:
        FieldError: for an unknown term, or one whose source is missing.
    """
    sources = {
        **_proprioception(contract, robot_joints),
        **_reference_terms(reference),
        **{name: (width, _extern_source(name, width)) for name, width in extern.items()},
    }
    terms = []
    start = 0
    for name in contract.observation_names:
        if name not in sources:
            raise FieldError(_missing_term(name, sources))
        width, source = sources[name]
        terms.append(ObservationTerm(name, start, start + width, source))
        start += width
    return ObservationLayout(tuple(terms))


def pack(layout: ObservationLayout, context: ObservationContext) -> Float32Array:
    """The observation, shape (..., N), float32; what a float32 cannot hold becomes infinite.

    Raises:
        FieldError: if a live term has another width than the one it was resolved with.
    """
    batch = context.state.joint_position.shape[:-1]
    observation = np.empty((*batch, layout.width), dtype=np.float32)
    with np.errstate(over="ignore", invalid="ignore"):  # the caller checks that the result is finite
        for term in layout.terms:
            observation[..., term.start : term.stop] = term.source(context)
    return observation


def _proprioception(contract: PolicyContract, robot_joints: tuple[str, ...]) -> dict[str, tuple[int, Source]]:
    order = joint_indices(contract.joint_names, robot_joints, "joint_names of the policy")
    default = contract.default_joint_pos
    n = len(order)
    return {
        "joint_pos": (n, lambda context: context.state.joint_position[..., order] - default),
        "joint_vel": (n, lambda context: context.state.joint_velocity[..., order]),
        "actions": (contract.action_count, lambda context: context.last_action),
        "imu_quaternion": (4, lambda context: context.state.imu_quaternion),
        "imu_angular_velocity": (3, lambda context: context.state.imu_angular_velocity),
        "imu_linear_acceleration": (3, lambda context: context.state.imu_linear_acceleration),
    }


def _reference_terms(reference: MotionReference) -> dict[str, tuple[int, Source]]:
    def source(name: str) -> Source:
        return lambda context: context.reference.term(name, context.frame)

    terms: dict[str, tuple[int, Source]] = {
        name: (table.shape[1], source(name)) for name, table in reference.terms.items()
    }
    if terms:
        terms["progress"] = (1, lambda context: np.asarray(context.reference.progress(context.frame))[..., None])
    return terms


def _extern_source(name: str, width: int) -> Source:
    def source(context: ObservationContext) -> Any:
        live = context.state.extern.get(name)
        if live is None:
            return 0.0  # never heard counts like too old: nothing pressed, no velocity asked for
        batch = context.state.joint_position.shape[:-1]
        if live.value.shape not in ((width,), (*batch, width)):  # assigned unchecked, one value would fill every slot
            raise FieldError(f"MITState.extern['{name}']: has shape {live.value.shape}, expected ({width},)")
        return live.at(context.state.time)

    return source


_REFERENCE_TERMS: Mapping[str, str] = MappingProxyType(
    {
        "motion_body_pos_b": "a tracking motion",
        "motion_body_ori_b": "a tracking motion",
        "target_keys": "a piano motion",
        "target_keys_future": "a piano motion",
        "progress": "a motion",
        "key_pressed": "a source of live key states",
    }
)


def _missing_term(name: str, sources: Mapping[str, object]) -> str:
    if name in _REFERENCE_TERMS:
        return f"observation term '{name}' needs {_REFERENCE_TERMS[name]}, and there is none"
    return known_names("observation term", name, sorted({*sources, *_REFERENCE_TERMS}))
