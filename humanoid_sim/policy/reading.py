"""Everything that speaks about a checkpoint, read and joined: its metadata and the files beside it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import FieldError, InputError, blaming
from humanoid_sim.policy.layers import Layer, Reading, join
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
_DIALECTS = ((is_own, read_own), (is_mjlab, read_mjlab), (is_holosoma, read_holosoma))
_MALFORMED = (TypeError, ValueError, KeyError, AttributeError, ArithmeticError)


def read_checkpoint(
    path: Path,
    metadata: Mapping[str, str],
    outputs: Collection[str] = (),
    contract_file: Path | None = None,
    robot_joints: tuple[str, ...] | None = None,
    width: int | None = None,
) -> Reading:
    """Return what everything that speaks about a checkpoint states together.

    A stamped checkpoint is complete by itself, so no trainer's file beside it is read; a `contract.yaml` always is.
    Raises `InputError` if a source is malformed.

    Args:
        outputs: names of the model's outputs.
        contract_file: a contract.yaml; None: the one beside the checkpoint, if there is one.
        robot_joints: the joints in the robot's own order, for sources that give places instead of names.
        width: N of the model's input, by which a trainer's file of another network is recognised.
    """
    chosen = find_contract(path) if contract_file is None else contract_file
    hand = [] if chosen is None else [read_contract_file(chosen)]
    inside, files = list[Layer](), list[Layer]()
    if _ANCHOR_QUATERNION in outputs:
        inside.append(Layer(f"assumed (output {_ANCHOR_QUATERNION})", {"reference_quaternion": "xyzw"}))
    if STAMP_KEY in metadata:
        inside += read_stamp(metadata, str(path))
    else:
        read = next((read for is_spoken, read in _DIALECTS if is_spoken(metadata)), None)
        with blaming(f"{path}: metadata", _MALFORMED):
            inside += read(metadata, str(path)) if read else []
        files = _side_layers(path, robot_joints)
    reading = join([*inside, *files, *hand], str(path))
    if any(line.startswith("observation") for line in reading.differences) and width is not None:
        alone, apart = (join([*some, *hand], str(path)) for some in (inside, files))
        if _width(alone) == width and _width(apart) not in (None, width):
            names = ", ".join(layer.source for layer in files if "observation" in layer.values)
            line = f"{names} is of another network than this model of {width} inputs, and is not read"
            return replace(alone, unused=(*alone.unused, line))
    return reading


def required_contract(reading: Reading, path: Path) -> PolicyContract:
    """Return the contract. Raises `InputError` with everything that keeps it from being one."""
    refusal = reading.refusal(own_contract(path).name)
    if refusal or reading.contract is None:
        raise InputError(f"{path}: {refusal}")
    return reading.contract


def _side_layers(path: Path, robot_joints: tuple[str, ...] | None) -> list[Layer]:
    """Return what the files state that trainers write beside the model, the one of its deployment last."""
    layers: list[Layer] = []
    env, deploy = find_beside(path, ENV_FILE), find_beside(path, DEPLOY_FILE)
    if env is not None:
        try:
            with blaming(env, _MALFORMED):
                layers += read_env(env)
        except InputError as error:
            layers.append(Layer(env.name, {}, unused=(f"{env.name} cannot be read: {error}",)))
    if deploy is not None:
        with blaming(deploy, _MALFORMED):
            layers += read_deploy(deploy, robot_joints)
    berkeley = find_berkeley(path)
    if berkeley is not None:
        with blaming(berkeley, _MALFORMED):
            layers += read_berkeley(berkeley, robot_joints)
    return layers


def _width(reading: Reading) -> int | None:
    """Return the width of the observation; None where the terms are not known."""
    try:
        return None if reading.outline is None else contract_layout(reading.outline).width
    except FieldError:
        return None
