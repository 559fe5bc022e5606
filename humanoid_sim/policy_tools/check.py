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
from humanoid_sim.policy.findings import SEVERITIES, Finding
from humanoid_sim.policy.golden import verify_golden
from humanoid_sim.policy.layers import Reading, outline
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.onnx_policy import OnnxModel, OnnxPolicy
from humanoid_sim.policy.readers.own import own_contract
from humanoid_sim.policy_tools import Check
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract, with_contract_physics
from humanoid_sim.robots.guards import describe_unwatched
from humanoid_sim.robots.imu import imu_line
from humanoid_sim.robots.mjcf import bare_model, prefix_line
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.stability import REFUSED_ABOVE, WARNED_ABOVE, DampingStability

_PROBES = 4
_STEPS = (0.00025, 0.0005, 0.001, 0.0025, 0.005)  # s; a damping that needs a shorter one is unstable
_SHOWN = {"error": ("bold red", "error(s)"), "warning": ("yellow", "warning(s)"), "info": ("cyan", "remark(s)")}


def check(options: Check) -> int:
    """Print the findings; exit status 1 if there is an error among them."""
    description = load_robot(options.robot, options.imu_site)
    findings = check_checkpoint(
        options.checkpoint,
        description,
        options.contract,
        hardware=options.hardware,
        physics_timestep=options.physics_timestep,
    )
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
    path: Path,
    description: RobotDescription,
    contract_file: Path | None = None,
    *,
    hardware: bool = False,
    physics_timestep: float | None = None,
) -> tuple[Finding, ...]:
    """Everything that can be said without running the policy on the robot, the worst first.

    Raises `InputError` if the checkpoint is not a model, the contract file is not there, or the robot's MJCF cannot be
    read.

    Args:
        contract_file: a contract.yaml; None: the one beside the checkpoint, if there is one.
        physics_timestep: s of the simulation; None: the robot's.
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
    findings = [*_source_findings(reading, policy, own_contract(path).name)]
    contract = reading.contract
    if contract is not None and policy.action_width == contract.action_count:
        bare = bare_model(description)
        checkpoint = Checkpoint(contract, policy, str(path), observation_width=policy.observation_width)
        if not any(finding.field == "observation" for finding in findings):  # its width is the model's
            findings += _network_findings(contract, policy)
        findings.append(_golden_finding(checkpoint))
        findings += contract_findings(contract, description, bare, hardware=hardware)
        if set(contract.joint_names) == set(description.joint_names):
            findings += _stability_findings(contract, description, physics_timestep)
            if unwatched := describe_unwatched(with_contract_physics(description, contract)):
                findings.append(Finding("info", "guards", unwatched.removeprefix("guards: ")))
        if prefix := prefix_line(description.mjcf_path):
            findings.append(Finding("info", "robot", prefix))
        if description.is_floating:
            findings.append(Finding("info", "imu", imu_line(bare, description)))
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def _source_findings(reading: Reading, policy: OnnxPolicy, hand: str) -> Iterator[Finding]:
    """Yield what keeps the sources from making a contract: widths first, then what is missing, all at once."""
    contract, width = outline(reading), policy.observation_width
    if contract is not None:
        try:
            layout = contract_layout(contract, width)
        except FieldError as error:
            yield Finding("error", "observation", str(error))
        else:
            if layout.width != width:
                terms = " + ".join(f"{term.name} {term.width}" for term in layout.terms)
                yield Finding("error", "observation", f"is {layout.width} wide, the model's input {width}: {terms}")
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


def _network_findings(contract: PolicyContract, policy: OnnxPolicy) -> Iterator[Finding]:
    """Run the model on zeros and on noise.

    A term whose values change nothing has a normaliser that has never seen them move, or stands in a wrong place.
    """
    layout = contract_layout(contract, policy.observation_width)
    probes = np.random.default_rng(0).normal(0.0, 1.0, (_PROBES, layout.width)).astype(np.float32)
    action = np.abs(policy(np.zeros_like(probes[0]), 0))
    joint, limit = contract.action_joint_names[int(np.argmax(action))], action_limit_of(contract)
    if not np.isfinite(action).all():
        yield Finding("error", "model", f"answers zeros with a number that is not finite, for {joint}", (joint,))
    elif action.max() > limit:
        message = f"answers zeros with {action.max():g} for {joint}, expected at most {limit:g}"
        yield Finding("error", "model", f"{message}: action_limit in x.contract.yaml raises it", (joint,))
    answers = [policy(probe, 0) for probe in probes]
    if all(np.array_equal(answer, answers[0]) for answer in answers):
        yield Finding("warning", "model", "gives the same action whatever it observes")
        return
    owner = np.array([layout.locate(i).partition("[")[0] for i in range(layout.width)])
    for term in layout.terms:
        silent = np.where(owner == term.name, np.float32(0.0), probes)
        if all(np.array_equal(policy(row, 0), answers[i]) for i, row in enumerate(silent)):
            yield Finding("warning", f"observation term {term.name}", "has no influence on the model's answer")


def _golden_finding(checkpoint: Checkpoint) -> Finding:
    try:
        label = verify_golden(checkpoint)
    except InputError as error:
        reason = str(error).removeprefix(f"{checkpoint.source}: golden vectors: ")
        return Finding("error", "golden vectors", reason)
    live = bool(checkpoint.contract.live_inputs)
    remedy = "a policy with live inputs has none" if live else "`stamp --trace` adds those of a trainer's run"
    none = f"there are none: wrong wiring would not be seen; {remedy}"
    return Finding("info", "golden vectors", label or none)


def _stability_findings(
    contract: PolicyContract, description: RobotDescription, physics_timestep: float | None
) -> Iterator[Finding]:
    """Yield whether the policy's damping is stable at the physics step; its joints must be the robot's."""
    robot = with_contract(description, contract)
    model = build_model(robot, physics_timestep=physics_timestep, scene=False)
    timestep = float(model.opt.timestep)
    damping = resolve_action(contract, description.joint_names).damping
    measure = DampingStability(model, robot).measure(damping)
    joint, value = measure.joint, measure.eigenvalue
    if value <= WARNED_ABOVE:
        return
    limit, effect = WARNED_ABOVE, "the velocity changes sign from step to step"
    if value > REFUSED_ABOVE:
        limit, effect = REFUSED_ABOVE, f"unstable above {REFUSED_ABOVE:g}, which play refuses"
    longest = timestep * limit / value
    shorter = [step for step in _STEPS if step < longest]
    gain = float(damping[description.joint_names.index(joint)])
    what = f"is {gain:g} for {joint}: dt·M⁻¹·K_d reaches {value:.2f} with a physics step of {timestep:g} s"
    if shorter and physics_timestep is None:
        message = f"{what}, {effect}; --physics-timestep {shorter[-1]:g} cures it"
        yield Finding("warning", "joint_damping", message, (joint,))
    else:
        message = f"{what}, {effect}; it takes a step below {longest:.2g} s"
        yield Finding("error" if value > REFUSED_ABOVE else "warning", "joint_damping", message, (joint,))
