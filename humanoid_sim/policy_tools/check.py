"""`policy check`: what is wrong, or looks wrong, with a checkpoint for a robot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from rich.markup import escape

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import regular_file
from humanoid_sim.policy.checkpoint import Checkpoint, read_checkpoint
from humanoid_sim.policy.checks import contract_findings
from humanoid_sim.policy.findings import SEVERITIES, Finding, Severity, assumptions
from humanoid_sim.policy.graph_motion import sweep_motion
from humanoid_sim.policy.layers import Reading
from humanoid_sim.policy.loaded_policy import contract_layout, width_problem
from humanoid_sim.policy.onnx_policy import OnnxModel, OnnxPolicy
from humanoid_sim.policy.readers.agent import missing_normaliser
from humanoid_sim.policy.traces import verify_golden
from humanoid_sim.policy_tools import Check
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.stability import DampingStability

_SHOWN: Mapping[Severity, tuple[str, str]] = {
    "error": ("bold red", "error(s)"),
    "warning": ("yellow", "warning(s)"),
    "info": ("cyan", "remark(s)"),
}


def check(options: Check) -> int:
    """Print the findings; exit status 1 if there is an error among them."""
    description = load_robot(options.robot)
    findings = check_checkpoint(options.checkpoint, description, options.contract, hardware=options.hardware)
    counts = Counter(finding.severity for finding in findings)
    console = make_console()
    for finding in findings:
        style = _SHOWN[finding.severity][0]
        console.print(f"[{style}]{finding.severity:<8}[/{style}]{escape(str(finding))}", soft_wrap=True)
    total = ", ".join(f"{counts[severity]} {plural}" for severity, (_, plural) in _SHOWN.items())
    console.print(f"{escape(str(options.checkpoint))} on '{escape(description.name)}': {total}", soft_wrap=True)
    return ExitStatus.of(counts["error"] == 0)


def check_checkpoint(
    path: Path, description: RobotDescription, contract_file: Path | None = None, *, hardware: bool = False
) -> tuple[Finding, ...]:
    """Return everything that can be said without running the policy on the robot, the worst first."""
    model = OnnxModel(path)  # what is not a model cannot be checked
    if contract_file is not None:
        regular_file(contract_file, "a contract.yaml")
    try:
        reading = read_checkpoint(path, model.metadata, contract_file, description.joint_names)
        names = {name.partition(".")[2]: value for name, value in reading.values.items() if name.startswith("tensors.")}
        policy = OnnxPolicy(model, TensorNames(**names))
    except InputError as error:
        return (Finding("error", "contract", str(error).removeprefix(f"{path}: ")),)
    findings = list(_source_findings(reading, policy))
    contract = reading.contract
    if contract is not None and policy.action_width == contract.action_count:
        findings += _model_findings(contract, policy)
        findings += contract_findings(contract, description, bare_model(description), hardware=hardware)
        findings += _stability_findings(contract, description)
        for source, values in assumptions(reading.values, reading.source).items():
            findings.append(Finding("warning", source, f"{values}: no source states it; x.contract.yaml can"))
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def _source_findings(reading: Reading, policy: OnnxPolicy) -> Iterator[Finding]:
    contract, width = reading.outline, policy.observation_width
    if contract is not None:
        try:
            layout = contract_layout(contract)
            if layout.width != width:
                yield Finding("error", "observation", width_problem(layout, width))
        except FieldError as error:
            yield Finding("error", "observation", str(error))
        if policy.action_width != contract.action_count:
            message = f"is {contract.action_count} wide, the model's output {policy.action_width}"
            yield Finding("error", "action_joint_names", message)
    yield from (Finding("error", field, text) for field, text in reading.problems.items())
    yield from (Finding("warning", "not used", line) for line in reading.unused)


def _model_findings(contract: PolicyContract, policy: OnnxPolicy) -> Iterator[Finding]:
    width, limit = policy.observation_width, contract.action_limit
    action, again, other = (policy(np.full(width, value, dtype=np.float32), 0) for value in (0.0, 0.0, 1.0))
    if not (most := np.abs(action).max()) <= limit:
        joint = contract.action_joint_names[int(np.argmax(np.abs(action)))]
        message = f"answers zeros with {most:g} for {joint}, expected a finite number of at most {limit:g}"
        remark = "; action_limit in x.contract.yaml raises it" if np.isfinite(most) else ""
        yield Finding("error", "model", f"{message}{remark}")
    elif (action != again).any():
        yield Finding("error", "model", "answers equal observations differently: it samples, export its mean")
    elif (action == other).all():
        yield Finding("warning", "model", "answers zeros and ones alike: the export lost weights, or the input")
    if text := missing_normaliser(policy.model.path):
        yield Finding("error", "model", text)
    source = str(policy.model.path)
    try:
        proof = verify_golden(Checkpoint(contract, policy, source, motion=sweep_motion(policy, contract)))
        none = "there are none: wrong wiring would not be seen; `stamp --trace` adds those of a trainer's run"
        yield Finding("info", "golden vectors", proof or none)
    except InputError as error:
        reason = str(error).removeprefix(f"{source}: ")
        field = "golden vectors" if reason.startswith("golden vectors") else "model"
        yield Finding("error", field, reason.removeprefix("golden vectors: "))


def _stability_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    if set(contract.joint_names) == set(description.joint_names):
        robot, gains = with_contract(description, contract), resolve_action(contract, description.joint_names)
        severity: Severity = "error"  # of a model that cannot be simulated at all
        try:
            stability = DampingStability(build_model(robot, scene=False), robot)
            severity = "warning"  # of a step, which is the robot's and not the policy's
            reason = stability.check(gains.damping, "", gains.stiffness)
        except InputError as error:
            reason = str(error)
        if reason:
            yield Finding(severity, "joint_damping", reason.removeprefix(": "))
