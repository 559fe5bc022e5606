"""Everything that speaks about a checkpoint, read and joined: its metadata and the files beside it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import yaml

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.policy.layers import Layer, Reading, join, outline
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.readers.berkeley import find_berkeley, read_berkeley
from humanoid_sim.policy.readers.holosoma import is_holosoma, read_holosoma
from humanoid_sim.policy.readers.isaaclab import ENV_FILE, read_env
from humanoid_sim.policy.readers.mjlab import is_mjlab, read_mjlab
from humanoid_sim.policy.readers.own import (
    STAMP_KEY,
    find_contract,
    is_own,
    own_contract,
    read_contract_file,
    read_own,
    read_stamp,
)
from humanoid_sim.policy.readers.trainer_files import find_beside
from humanoid_sim.policy.readers.unitree import DEPLOY_FILE, read_deploy

_ANCHOR_QUATERNION = "ref_quat_xyzw"  # holosoma's output


def read_checkpoint(
    path: Path,
    metadata: Mapping[str, str],
    outputs: Collection[str] = (),
    contract_file: Path | None = None,
    robot_joints: tuple[str, ...] | None = None,
    width: int | None = None,
) -> Reading:
    """Return what everything that speaks about a checkpoint says together.

    A stamped checkpoint is complete by itself, so no trainer's file beside it is read; a `contract.yaml` always is.
    Raises `InputError` if a source is malformed.

    Args:
        outputs: names of the model's outputs.
        contract_file: a contract.yaml; None: the one beside the checkpoint, if there is one.
        robot_joints: the joints in the robot's own order, for sources that give places instead of names.
        width: N of the model's input: it tells a trainer's file of another network.
    """
    chosen = find_contract(path) if contract_file is None else contract_file
    hand = [] if chosen is None else [read_contract_file(chosen)]
    inside = _metadata_layers(metadata, str(path))
    if _ANCHOR_QUATERNION in outputs:
        source = f"assumed (output {_ANCHOR_QUATERNION})"
        inside.insert(0, Layer(source, {"reference_quaternion": "xyzw"}, is_assumed=True))
    beside = [] if STAMP_KEY in metadata else list(_side_layers(path, robot_joints))
    files, unused = [layer for layers in beside for layer in layers], tuple(_unread(path))
    reading = join([*inside, *files, *hand], str(path), robot_joints)
    if any(line.startswith("observation") for line in reading.differences) and width is not None:
        alone, apart = (join([*some, *hand], str(path), robot_joints) for some in (inside, files))
        if _width(alone) == width and _width(apart) not in (None, width):
            names = ", ".join(dict.fromkeys(layer.source for layer in files if "observation" in layer.values))
            unused += (f"{names} is of another network than this model of {width} inputs, and is not read",)
            reading = alone
    return replace(reading, unused=reading.unused + unused)


def required_contract(reading: Reading, path: Path) -> PolicyContract:
    """Return the contract. Raises `InputError` with everything that keeps it from being one."""
    refusal = reading.refusal(own_contract(path).name)
    if refusal or reading.contract is None:
        raise InputError(f"{path}: {refusal}")
    return reading.contract


def _metadata_layers(metadata: Mapping[str, str], where: str) -> list[Layer]:
    """Return what a model's metadata says, in whichever dialect it is; nothing if it says nothing."""
    if STAMP_KEY in metadata:
        return read_stamp(metadata, where)
    for is_spoken, read in ((is_own, read_own), (is_mjlab, read_mjlab), (is_holosoma, read_holosoma)):
        if is_spoken(metadata):
            return read(metadata, where)
    return []


def _side_layers(path: Path, robot_joints: tuple[str, ...] | None) -> Iterator[list[Layer]]:
    """Yield what each file says that trainers write beside the model, the one of its deployment last."""
    env = find_beside(path, ENV_FILE)
    if env is not None:
        try:
            yield read_env(env)
        except InputError as error:
            yield [Layer(env.name, {}, unused=(f"{env.name} cannot be read: {error}",))]
    deploy = find_beside(path, DEPLOY_FILE)
    if deploy is not None:
        yield read_deploy(deploy, robot_joints)
    berkeley = find_berkeley(path)
    if berkeley is not None:
        yield read_berkeley(berkeley, robot_joints)


def _unread(path: Path) -> Iterator[str]:
    """Yield descriptions beside the model that are not read, by what they are."""
    leapp = path.with_suffix(".yaml")
    if leapp.is_file() and is_leapp(leapp):
        yield f"{leapp.name} is a LEAPP description, which is not read"


def is_leapp(path: Path) -> bool:
    """Return whether a YAML file is the description of a LEAPP bundle."""
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return False
    return isinstance(document, dict) and {"models", "pipeline"} <= document.keys()


def _width(reading: Reading) -> int | None:
    """Return the width of the observation; None where the terms are not known."""
    contract = outline(reading)
    try:
        return None if contract is None else contract_layout(contract).width
    except FieldError:
        return None
