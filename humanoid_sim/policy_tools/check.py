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
from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.controllers.policy_step import action_limit_of, resolve_action
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import regular_file
from humanoid_sim.mit import Float32Array
from humanoid_sim.policy.checkpoint import Checkpoint, read_model
from humanoid_sim.policy.checks import contract_findings
from humanoid_sim.policy.findings import SEVERITIES, Finding, Severity, sorted_findings
from humanoid_sim.policy.golden import verify_golden
from humanoid_sim.policy.layers import Reading, outline
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.onnx_policy import OnnxModel, OnnxPolicy
from humanoid_sim.policy.readers.own import own_contract
from humanoid_sim.policy_tools import Check
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import (
    RobotDescription,
    load_robot,
    with_contract,
    with_contract_physics,
)
from humanoid_sim.robots.guards import describe_unwatched
from humanoid_sim.robots.mjcf import bare_model, imu_line, prefix_line
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.stability import REFUSED_ABOVE, WARNED_ABOVE, DampingStability

_PROBES = 4
_STEPS = (0.00025, 0.0005, 0.001, 0.0025, 0.005)
_SHORTEST_STEP = _STEPS[0]
"""s: a shorter one is no remedy for a damping that is unstable."""
_STYLES: dict[Severity, str] = {"error": "bold red", "warning": "yellow", "info": "cyan"}
_PLURALS: dict[Severity, str] = {"error": "error(s)", "warning": "warning(s)", "info": "remark(s)"}


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
        document = {
            "checkpoint": str(options.checkpoint),
            "robot": description.name,
            "counts": counts,
            "findings": [asdict(finding) for finding in findings],
        }
        print(json.dumps(document, indent=2))
    else:
        _print(findings, counts, f"{options.checkpoint} on '{description.name}'")
    return ExitStatus.of(counts["error"] == 0)


def _print(findings: tuple[Finding, ...], counts: dict[Severity, int], what: str) -> None:
    console = make_console()
    for finding in findings:
        style = _STYLES[finding.severity]
        console.print(f"[{style}]{finding.severity:<8}[/{style}]{escape(str(finding))}", soft_wrap=True)
    total = ", ".join(f"{counts[severity]} {_PLURALS[severity]}" for severity in SEVERITIES)
    console.print(f"{escape(what)}: {total}", soft_wrap=True)


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
        policy = OnnxPolicy(model, _tensors(reading))
    except InputError as error:
        return (Finding("error", "contract", str(error).removeprefix(f"{path}: ")),)
    findings = [*_sources(reading, policy, own_contract(path).name)]
    if reading.contract is not None and policy.action_width == reading.contract.action_count:
        checkpoint = Checkpoint(reading.contract, policy, str(path), observation_width=policy.observation_width)
        findings += _findings(checkpoint, description, hardware, physics_timestep)
    return sorted_findings(findings)


def _tensors(reading: Reading) -> TensorNames:
    parts = {name.partition(".")[2]: value for name, value in reading.values.items() if name.startswith("tensors.")}
    return TensorNames(**parts)


def _sources(reading: Reading, policy: OnnxPolicy, hand: str) -> Iterator[Finding]:
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


def _findings(
    checkpoint: Checkpoint, description: RobotDescription, hardware: bool, physics_timestep: float | None
) -> Iterator[Finding]:
    contract, model = checkpoint.contract, bare_model(description)
    yield from _model_findings(checkpoint)
    yield from _golden(checkpoint)
    yield from contract_findings(contract, description, model, hardware=hardware)
    if set(contract.joint_names) == set(description.joint_names):
        yield from _stability(contract, description, physics_timestep)
        unwatched = describe_unwatched(with_contract_physics(description, contract))
        if unwatched:
            yield Finding("info", "guards", unwatched.removeprefix("guards: "))
    if prefix := prefix_line(description.mjcf_path):
        yield Finding("info", "robot", prefix)
    if description.is_floating:
        yield Finding("info", "imu", imu_line(model, description))


def _golden(checkpoint: Checkpoint) -> Iterator[Finding]:
    try:
        label = verify_golden(checkpoint)
    except (InputError, FieldError) as error:
        yield Finding("error", "golden vectors", str(error).removeprefix(f"{checkpoint.source}: golden vectors: "))
        return
    remedy = "`stamp --trace` adds those of a trainer's run"
    if checkpoint.contract.live_inputs:
        remedy = "a policy with live inputs has none"
    message = label or f"there are none: wrong wiring would not be seen; {remedy}"
    yield Finding("info", "golden vectors", message)


def _model_findings(checkpoint: Checkpoint) -> Iterator[Finding]:
    """Run the model on zeros and on noise."""
    width = checkpoint.observation_width
    try:
        layout = contract_layout(checkpoint.contract, width)
    except FieldError:
        return
    if width == layout.width:
        yield from _answers(checkpoint, width)
        yield from _silent_terms(checkpoint, layout)


def _answers(checkpoint: Checkpoint, width: int) -> Iterator[Finding]:
    action = np.abs(_run(checkpoint, np.zeros(width, dtype=np.float32)))
    joint, limit = checkpoint.contract.action_joint_names[int(np.argmax(action))], action_limit_of(checkpoint.contract)
    if not np.isfinite(action).all():
        yield Finding("error", "model", f"answers zeros with a number that is not finite, for {joint}", (joint,))
    elif action.max() > limit:
        message = f"answers zeros with {action.max():g} for {joint}, expected at most {limit:g}"
        yield Finding("error", "model", f"{message}: action_limit in x.contract.yaml raises it", (joint,))


def _silent_terms(checkpoint: Checkpoint, layout: ObservationLayout) -> Iterator[Finding]:
    """Terms whose values change nothing in the answer: a normaliser that has never seen them move, or a wrong place."""
    rng = np.random.default_rng(0)
    probes = rng.normal(0.0, 1.0, (_PROBES, layout.width)).astype(np.float32)
    owner = np.array([layout.locate(i).partition("[")[0] for i in range(layout.width)])
    answers = [_run(checkpoint, probe) for probe in probes]
    if all(np.array_equal(answer, answers[0]) for answer in answers):
        yield Finding("warning", "model", "gives the same action whatever it observes")
        return
    for term in layout.terms:
        silent = probes.copy()
        silent[:, owner == term.name] = 0.0
        if all(np.array_equal(_run(checkpoint, row), answers[i]) for i, row in enumerate(silent)):
            message = "has no influence on the model's answer"
            yield Finding("warning", f"observation term {term.name}", message)


def _run(checkpoint: Checkpoint, observation: Float32Array) -> Float32Array:
    return np.asarray(checkpoint.policy(observation, 0), dtype=np.float32)


def _stability(
    contract: PolicyContract, description: RobotDescription, physics_timestep: float | None
) -> Iterator[Finding]:
    """Yield whether the policy's damping is stable at the physics step: `humanoid_sim.simulation.stability`.

    The joints' names must be the robot's.
    """
    robot = with_contract(description, contract)
    model = build_model(robot, physics_timestep=physics_timestep, scene=False)
    timestep = float(model.opt.timestep)
    damping = resolve_action(contract, description.joint_names).damping
    measure = DampingStability(model, robot).measure(damping)
    if measure.eigenvalue <= WARNED_ABOVE:
        return
    joint, value = measure.joint, measure.eigenvalue
    gain = float(damping[description.joint_names.index(joint)])
    what = f"is {gain:g} for {joint}: dt·M⁻¹·K_d reaches {value:.2f} with a physics step of {timestep:g} s"
    longest = timestep * REFUSED_ABOVE / value
    if value <= REFUSED_ABOVE:
        calm = timestep * WARNED_ABOVE / value
        message = f"{what}, where the velocity changes sign from step to step; below {calm:.2g} s it does not"
        yield Finding("warning", "joint_damping", message, (joint,))
    elif longest > _SHORTEST_STEP and physics_timestep is None:
        step = max(step for step in _STEPS if step < longest)
        message = f"{what}, unstable above {REFUSED_ABOVE:g}, which play refuses: --physics-timestep {step:g} does"
        yield Finding("warning", "joint_damping", message, (joint,))
    else:
        works = f"; a step below {longest:.2g} s works" if longest > 0.0 else ""
        yield Finding("error", "joint_damping", f"{what}, unstable above {REFUSED_ABOVE:g}{works}", (joint,))
