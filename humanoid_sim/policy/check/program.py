"""All checks of a checkpoint against a robot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import regular_file
from humanoid_sim.policy.check.estimates import estimate_findings, rate_finding
from humanoid_sim.policy.check.finding import Finding, sorted_findings
from humanoid_sim.policy.check.gains import motor_findings, stability_finding
from humanoid_sim.policy.check.model import model_findings
from humanoid_sim.policy.check.names import body_findings, joint_findings
from humanoid_sim.policy.check.ranges import range_findings
from humanoid_sim.policy.check.suspicious import suspicious_findings
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.golden.verify import verify_golden
from humanoid_sim.policy.onnx_model import OnnxModel
from humanoid_sim.policy.onnx_policy import OnnxPolicy, load_checkpoint
from humanoid_sim.robots.description import RobotDescription

__all__ = ["check_checkpoint"]


def check_checkpoint(
    path: Path,
    description: RobotDescription,
    contract_file: Path | None = None,
    *,
    hardware: bool = False,
    physics_timestep: float | None = None,
) -> tuple[Finding, ...]:
    """Everything that can be said without running the policy on the robot, the worst first.

    A contract that contradicts itself or is not complete is one finding, and the only one.

    Args:
        path: the checkpoint.
        description: the robot.
        contract_file: a contract.yaml; None: the one beside the checkpoint, if there is one.
        hardware: it is for the real robot.
        physics_timestep: s of the simulation; None: the robot's.

    Raises:
        InputError: the checkpoint is no model, the contract file is not there, or the robot's MJCF cannot be read.
    """
    OnnxModel(path)  # what is no model cannot be checked
    if contract_file is not None:
        regular_file(contract_file, "a contract.yaml")
    try:
        checkpoint = load_checkpoint(path, contract_file, description.joint_names, verify=False)
    except InputError as error:
        return (Finding("error", "contract", str(error).removeprefix(f"{path}: ")),)
    return sorted_findings(_findings(checkpoint, description, hardware, physics_timestep))


def _findings(
    checkpoint: Checkpoint, description: RobotDescription, hardware: bool, physics_timestep: float | None
) -> Iterator[Finding]:
    contract = checkpoint.contract
    joints = tuple(joint_findings(contract, description))
    yield from joints
    if contract.body_names or contract.anchor_body:
        yield from body_findings(contract, _bodies(description), description.name)
    yield from model_findings(checkpoint)
    yield from _golden(checkpoint)
    yield from motor_findings(contract, description, hardware=hardware)
    yield from range_findings(contract, description)
    if not joints:
        yield from stability_finding(contract, description, physics_timestep)
    yield from suspicious_findings(contract, description)
    yield from estimate_findings(contract, hardware=hardware)
    if hardware:
        yield from rate_finding(contract, description)


def _golden(checkpoint: Checkpoint) -> Iterator[Finding]:
    if not isinstance(checkpoint.policy, OnnxPolicy):
        return
    try:
        label = verify_golden(checkpoint, checkpoint.policy.metadata)
    except (InputError, FieldError) as error:
        yield Finding("error", "golden vectors", str(error).removeprefix(f"{checkpoint.source}: golden vectors: "))
        return
    message = label or "there are none: wrong wiring would not be seen; `stamp --trace` adds those of a trainer's run"
    yield Finding("info", "golden vectors", message)


def _bodies(description: RobotDescription) -> tuple[str, ...]:
    from humanoid_sim.simulation.model import build_model  # noqa: PLC0415 - MuJoCo is heavy

    model = build_model(description, scene=False)
    return tuple(model.body(i).name for i in range(1, model.nbody))
