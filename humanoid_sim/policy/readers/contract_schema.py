"""The schema of `contract.yaml`; `docs/contract.md` explains it with examples."""

from __future__ import annotations

from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from humanoid_sim.controllers.contract import HistoryLayout, TaskType
from humanoid_sim.controllers.terms import ActionForm, Frame, HistoryOrder, OrientationLayout, QuaternionOrder

__all__ = ["ContractFields", "ContractFile", "TermFields", "TermOptions"]

Numbers = float | list[float]
"""One number for all, or one each."""
Pair = tuple[float, float]


class _Fields(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What is left out stays unset."""


class TermOptions(_Fields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How one observation term is made; the meaning of each is in `controllers.terms.Term`."""

    kind: str | UnsetType = UNSET
    scale: Numbers | UnsetType = UNSET
    clip: Pair | UnsetType | None = UNSET
    history: int | UnsetType = UNSET
    history_order: HistoryOrder | UnsetType = UNSET
    frame: Frame | UnsetType = UNSET
    relative: bool | UnsetType = UNSET
    layout: OrientationLayout | UnsetType = UNSET
    inverse: bool | UnsetType = UNSET
    quaternion: QuaternionOrder | UnsetType = UNSET
    form: ActionForm | UnsetType = UNSET
    joints: list[str] | UnsetType = UNSET


class TermFields(TermOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A term of the observation, with its options."""

    name: str


class CommandRangeFields(_Fields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Least and greatest velocity command."""

    lin_vel_x: Pair
    lin_vel_y: Pair
    ang_vel_z: Pair


class PhaseFields(_Fields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The gait clock, as `controllers.phase.PhaseRule`."""

    period: float
    offsets: list[float] | UnsetType = UNSET
    advance_first: bool | UnsetType = UNSET
    standing_threshold: float | UnsetType = UNSET
    standing_value: float | UnsetType | None = UNSET
    standing_restarts: bool | UnsetType = UNSET


class TensorFields(_Fields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Names in the model's graph."""

    observation: str | UnsetType = UNSET
    action: str | UnsetType = UNSET
    time_step: str | UnsetType = UNSET


class ContractFields(_Fields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Every field of a `PolicyContract`, each of which may be left out."""

    task_type: TaskType | UnsetType = UNSET
    joint_names: list[str] | UnsetType = UNSET
    action_joint_names: list[str] | UnsetType = UNSET
    joint_stiffness: Numbers | UnsetType = UNSET
    joint_damping: Numbers | UnsetType = UNSET
    default_joint_pos: Numbers | UnsetType = UNSET
    observation: list[str | TermFields] | UnsetType = UNSET
    terms: dict[str, dict[str, Any]] | UnsetType = UNSET
    """Each one `TermOptions`, converted by itself: msgspec does not name the key at which something is wrong."""
    command_names: list[str] | UnsetType = UNSET
    command_ranges: CommandRangeFields | UnsetType | None = UNSET
    action_scale: Numbers | UnsetType = UNSET
    action_offset: Numbers | UnsetType = UNSET
    action_clip: float | UnsetType = UNSET
    position_clip: list[Pair] | UnsetType | None = UNSET
    policy_dt: float | UnsetType = UNSET
    body_names: list[str] | UnsetType = UNSET
    anchor_body: str | UnsetType = UNSET
    align_reference: bool | UnsetType = UNSET
    reference_quaternion: QuaternionOrder | UnsetType = UNSET
    history_layout: HistoryLayout | UnsetType = UNSET
    phase: PhaseFields | UnsetType | None = UNSET
    lookahead_steps: list[int] | UnsetType = UNSET
    dataset_repo_id: str | UnsetType = UNSET
    tensors: TensorFields | UnsetType = UNSET


class ContractFile(ContractFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A whole file: fields that have to agree with the other sources, and fields that override them."""

    override: ContractFields | UnsetType = UNSET
