"""`policy check`: what is wrong, or looks wrong, with a checkpoint for a robot."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.markup import escape

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.controllers.policy_step import action_limit_of, resolve_action
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import regular_file
from humanoid_sim.policy.checkpoint import Checkpoint, read_model
from humanoid_sim.policy.checks import contract_findings
from humanoid_sim.policy.findings import SEVERITIES, Finding, Severity
from humanoid_sim.policy.golden import verify_golden
from humanoid_sim.policy.layers import Reading
from humanoid_sim.policy.loaded_policy import contract_layout, width_problem
from humanoid_sim.policy.onnx_policy import OnnxModel, OnnxPolicy
from humanoid_sim.policy.readers.own import own_contract
from humanoid_sim.policy_tools import Check
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract, with_contract_physics
from humanoid_sim.robots.guards import describe_unwatched
from humanoid_sim.robots.imu import imu_line
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.stability import DampingStability

_SHOWN = {"error": ("bold red", "error(s)"), "warning": ("yellow", "warning(s)"), "info": ("cyan", "remark(s)")}


def check(options: Check) -> int:
    """Print the findings; exit status 1 if there is an error among them."""
    description = load_robot(options.robot, options.imu_site)
    findings = check_checkpoint(options.checkpoint, description, options.contract, hardware=options.hardware)
    counts = {severity: sum(finding.severity == severity for finding in findings) for severity in SEVERITIES}
    if options.json:
        what = {"checkpoint": str(options.checkpoint), "robot": description.name}
        document = {**what, "counts": counts, "findings": [asdict(finding) for finding in findings]}
        print(json.dumps(document, indent=2))
        return ExitStatus.of(counts["error"] == 0)
    console = make_console()
    for finding in findings:
        style = _SHOWN[finding.severity][0]
        console.print(f"[{style}]{finding.severity:<8}[/{style}]{escape(str(finding))}", soft_wrap=True)
    total = ", ".join(f"{count} {_SHOWN[severity][1]}" for severity, count in counts.items())
    console.print(f"{escape(str(options.checkpoint))} on '{escape(description.name)}': {total}", soft_wrap=True)
    return ExitStatus.of(counts["error"] == 0)


def check_checkpoint(
    path: Path, description: RobotDescription, contract_file: Path | None = None, *, hardware: bool = False
) -> tuple[Finding, ...]:
    """Everything that can be said without running the policy on the robot, the worst first.

    Raises `InputError` if the checkpoint is not a model, the contract file is not there, or the robot's MJCF cannot be
    read.

    Args:
        contract_file: a contract.yaml; None: the one beside the checkpoint, if there is one.
    """
    model = OnnxModel(path)  # what is not a model cannot be checked
    if contract_file is not None:
        regular_file(contract_file, "a contract.yaml")
    try:
        reading = read_model(model, contract_file, description.joint_names)
        names = {name.partition(".")[2]: value for name, value in reading.values.items() if name.startswith("tensors.")}
        policy = OnnxPolicy(model, TensorNames(**names))
    except InputError as error:
        return (Finding("error", "contract", str(error).removeprefix(f"{path}: ")),)
    findings = list(_source_findings(reading, policy, own_contract(path).name))
    contract = reading.contract
    if contract is not None and policy.action_width == contract.action_count:
        bare = bare_model(description)
        findings += _answer_findings(contract, policy)
        checkpoint = Checkpoint(contract, policy, str(path), observation_width=policy.observation_width)
        findings.append(_golden_finding(checkpoint))
        findings += contract_findings(contract, description, bare, hardware=hardware)
        if set(contract.joint_names) == set(description.joint_names):
            findings += _stability_findings(contract, description)
            if unwatched := describe_unwatched(with_contract_physics(description, contract)):
                findings.append(Finding("info", "guards", unwatched.removeprefix("guards: ")))
        if description.is_floating:
            findings.append(Finding("info", "imu", imu_line(bare, description)))
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def _source_findings(reading: Reading, policy: OnnxPolicy, hand: str) -> Iterator[Finding]:
    """Yield what keeps the sources from making a contract: widths first, then what is missing, all at once."""
    contract, width = reading.outline, policy.observation_width
    if contract is not None:
        try:
            layout = contract_layout(contract, width)
            problem = "" if layout.width == width else width_problem(layout, width)
        except FieldError as error:
            problem = str(error)
        if problem:
            yield Finding("error", "observation", problem)
        if policy.action_width != contract.action_count:
            message = f"is {contract.action_count} wide, the model's output {policy.action_width}"
            yield Finding("error", "action_joint_names", message)
    if reading.missing:
        yield Finding("error", "contract", f"lacks {', '.join(reading.missing)}: give what is missing in {hand}")
    for line in reading.differences:
        field, _, what = line.partition(": ")
        yield Finding("error", field, f"{what}; the right value in {hand} decides")
    if reading.problem:
        yield Finding("error", "contract", reading.problem)
    for line in reading.unused:
        yield Finding("warning", "not used", line)


def _answer_findings(contract: PolicyContract, policy: OnnxPolicy) -> Iterator[Finding]:
    action = np.abs(policy(np.zeros(policy.observation_width, dtype=np.float32), 0))
    joint, limit = contract.action_joint_names[int(np.argmax(action))], action_limit_of(contract)
    if not action.max() <= limit:
        message = f"answers zeros with {action.max():g} for {joint}, expected a finite number of at most {limit:g}"
        yield Finding("error", "model", f"{message}; action_limit in x.contract.yaml raises it", (joint,))


def _golden_finding(checkpoint: Checkpoint) -> Finding:
    try:
        label = verify_golden(checkpoint)
    except InputError as error:
        reason = str(error).removeprefix(f"{checkpoint.source}: ").removeprefix("golden vectors: ")
        return Finding("error", "golden vectors", reason)
    none = "there are none: wrong wiring would not be seen; `stamp --trace` adds those of a trainer's run"
    return Finding("info", "golden vectors", label or none)


def _stability_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Yield whether the policy's damping is stable at the robot's physics step; its joints must be the robot's."""
    robot = with_contract(description, contract)
    gains = resolve_action(contract, description.joint_names)
    try:
        warning = DampingStability(build_model(robot, scene=False), robot).check(gains.damping, "", gains.stiffness)
        severity: Severity = "warning"
    except InputError as error:
        warning, severity = str(error), "error"
    if warning:
        yield Finding(severity, "joint_damping", warning.removeprefix(": "))
