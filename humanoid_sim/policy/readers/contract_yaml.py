"""`contract.yaml`: any field of a contract, written by hand; under `override:` also against what other sources say."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar, get_args

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from humanoid_sim.controllers.contract import HistoryLayout, PhaseRule, TaskType
from humanoid_sim.controllers.terms import ActionForm, Frame, HistoryOrder, OrientationLayout, QuaternionOrder
from humanoid_sim.errors import FieldError, InputError, known_names
from humanoid_sim.files import is_file
from humanoid_sim.policy.readers.partial import Given, PartialContract
from humanoid_sim.policy.readers.text_values import cut, one_line
from humanoid_sim.strict_yaml import read_yaml

__all__ = [
    "COMMAND_AXES",
    "CONTRACT_FILE",
    "ContractFields",
    "ContractFile",
    "TermFields",
    "TermOptions",
    "find_contract",
    "parse_contract",
    "read_contract_file",
]


CONTRACT_FILE = "contract.yaml"
COMMAND_AXES = ("lin_vel_x", "lin_vel_y", "ang_vel_z")
"""Of the velocity command, in the order of a contract's `command_ranges`."""


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


def find_contract(checkpoint: Path) -> Path | None:
    """`<checkpoint's stem>.contract.yaml`, or else `contract.yaml`, in the checkpoint's folder; None without one."""
    places = (checkpoint.with_name(f"{checkpoint.stem}.{CONTRACT_FILE}"), checkpoint.with_name(CONTRACT_FILE))
    return next((place for place in places if is_file(place)), None)


def read_contract_file(path: Path) -> list[PartialContract]:
    """The file's own fields and, if it has any, its overrides.

    Raises:
        InputError: one line with the file, the path of the field, and what is wrong.
    """
    return parse_contract(read_yaml(path), str(path), path.name)


def parse_contract(document: Any, where: str, source: str) -> list[PartialContract]:
    """The same of a document that has been read already.

    Args:
        document: as YAML gives it.
        where: what to call the file in messages.
        source: what to call it in the contract's provenance.

    Raises:
        InputError: as `read_contract_file`.
    """
    file = _convert({} if document is None else document, ContractFile, where, "")
    partials = [_partial(file, where, source, overrides=False)]
    if isinstance(file.override, ContractFields):
        partials.append(_partial(file.override, where, f"{source} override", overrides=True))
    return partials


def _partial(section: ContractFields, where: str, source: str, *, overrides: bool) -> PartialContract:
    fields: dict[str, Given] = {}
    terms: dict[str, dict[str, Given]] = {}
    prefix = "override." if overrides else ""
    for name, value in _set_fields(section):
        if name in ("override", "terms"):
            continue
        if name == "tensors":
            fields |= {f"tensors.{key}": Given(text, source) for key, text in _set_fields(value)}
            continue
        try:
            fields[name] = Given(_value(name, value), source)
        except FieldError as error:
            raise InputError(f"{where}: {prefix}{name}.{str(error).partition('.')[2]}") from None
        if name == "observation":
            for term in value:
                if isinstance(term, TermFields):
                    terms.setdefault(term.name, {}).update(_options(term, source))
    if isinstance(section.terms, dict):
        for term_name, document in section.terms.items():
            options = _convert(document, TermOptions, where, f"{prefix}terms.{term_name}")
            for option, value in _options(options, source).items():
                if option in terms.setdefault(term_name, {}):
                    raise InputError(f"{where}: {prefix}terms.{term_name}.{option}: is given in observation as well")
                terms[term_name][option] = value
    return PartialContract(source, fields, terms, overrides=overrides)


_Struct = TypeVar("_Struct", bound=msgspec.Struct)


def _convert(document: Any, struct: type[_Struct], where: str, place: str) -> _Struct:
    """A document as a struct; `place` is where in the file it stands.

    Raises:
        InputError: with the path of the field, and what is wrong.
    """
    try:
        return msgspec.convert(document, struct)
    except msgspec.ValidationError as error:
        problem = _problem(str(error), document, struct)
        joint = "" if not place else ": " if problem.startswith("is ") or problem.startswith("unknown ") else "."
        raise InputError(f"{where}: {one_line(f'{place}{joint}{problem}')}") from None
    except (OverflowError, RecursionError) as error:
        raise InputError(f"{where}: {error}") from None


def _set_fields(struct: msgspec.Struct) -> Iterator[tuple[str, Any]]:
    for name in struct.__struct_fields__:
        value = getattr(struct, name)
        if value is not msgspec.UNSET:
            yield name, value


def _options(term: TermOptions, source: str) -> dict[str, Given]:
    return {
        name: Given(tuple(value) if name == "joints" else _number_or_array(value), source)
        for name, value in _set_fields(term)
        if name != "name"
    }


def _value(name: str, value: Any) -> Any:
    if name == "observation":
        return tuple(term if isinstance(term, str) else term.name for term in value)
    if isinstance(value, CommandRangeFields):
        return np.array([getattr(value, axis) for axis in COMMAND_AXES])
    if isinstance(value, PhaseFields):
        return PhaseRule(**dict(_set_fields(value)))
    if name == "position_clip":
        return None if value is None else np.array(value, dtype=np.float64).reshape(-1, 2)
    if isinstance(value, list) and name.endswith(("_names", "_steps")):
        return tuple(value)
    return _number_or_array(value)


def _number_or_array(value: Any) -> Any:
    return np.array(value, dtype=np.float64) if isinstance(value, list) else value


_ACCEPTED = {
    "float": "a number",
    "int": "a whole number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "a mapping",
    "null": "null",
}
"""What msgspec calls a type, and what a person does."""


def _problem(message: str, document: Any, struct: type[msgspec.Struct]) -> str:
    """Turn ``Expected `float`, got `str` - at `$.phase.period` `` into `phase.period: is 'x', expected a number`."""
    problem, _, place = message.partition(" - at `$")
    place = place.rstrip("`").lstrip(".")
    value = _at(document, place)
    expected, is_type, _ = problem.removeprefix("Expected ").partition(", got ")
    if is_type:
        accepted = " or ".join(_ACCEPTED.get(name, name) for name in expected.strip("`").split(" | "))
        problem = f"is {cut(repr(value), 60)}, expected {accepted}"
    elif problem.startswith("Object contains unknown field"):
        problem = known_names("field", problem.split("`")[1], _known(place, struct))
    elif problem.startswith("Invalid enum value"):
        words = _WORDS[place.rpartition(".")[2]]
        problem = f"is {cut(repr(value), 60)}, expected one of {', '.join(words)}"
    return f"{place}: {problem}" if place else problem


_WORDS = {
    "task_type": get_args(TaskType),
    "history_layout": get_args(HistoryLayout),
    "history_order": get_args(HistoryOrder),
    "frame": get_args(Frame),
    "layout": get_args(OrientationLayout),
    "quaternion": get_args(QuaternionOrder),
    "reference_quaternion": get_args(QuaternionOrder),
    "form": get_args(ActionForm),
}
_INNER: dict[str, type[msgspec.Struct]] = {
    "observation": TermFields,
    "phase": PhaseFields,
    "tensors": TensorFields,
    "command_ranges": CommandRangeFields,
}


def _known(place: str, struct: type[msgspec.Struct]) -> tuple[str, ...]:
    """The fields that exist at a place in the document."""
    parts = place.removeprefix("override").lstrip(".")
    for name, inner in _INNER.items():
        if parts.startswith(name):
            return inner.__struct_fields__
    return (ContractFields if place.startswith("override") else struct).__struct_fields__


def _at(document: Any, place: str) -> Any:
    """The value at a path such as `observation[3].scale`."""
    for part in place.replace("[", ".[").split("."):
        if not part:
            continue
        try:
            document = document[int(part[1:-1])] if part.startswith("[") else document[part]
        except (KeyError, IndexError, TypeError, ValueError):
            return document
    return document
