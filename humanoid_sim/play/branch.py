"""A run that begins in a recorded instant: `--branch run.mcap@12.5`.

An instant of a simulation is reached by simulating the recorded run again from its start, under the recorded commands;
every reading must be the recorded one, bit for bit. The control stack's memory comes from repeating the recorded
inputs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from humanoid_sim.controllers.base import REMOTE_POLICY, RL_POLICY
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.rl_policy import RLPolicyController, RLPolicyMemory
from humanoid_sim.controllers.supervisor import Supervisor, SupervisorMemory, start_reason
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Event, EventKind, Mode, TickRecord
from humanoid_sim.mit import GRAVITY_LEVERS, VELOCITY_COMMAND, FloatArray
from humanoid_sim.play.options import PlayConfig, parse_branch
from humanoid_sim.play.played_robot import RobotSetup
from humanoid_sim.policy.contract_json import encode
from humanoid_sim.recording.reader import Entry, Recording, open_recording, recorded_settings
from humanoid_sim.recording.repeat import RecordedPolicy, first_difference, state_difference
from humanoid_sim.recording.start import START_DOCUMENT
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.session.recorded_inputs import RecordedInputs
from humanoid_sim.simulation.floating_base import support_in_mode
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.stack import rebuild_supervisor, recorded_contract
from humanoid_sim.strict_json import parse_json


@dataclass(frozen=True, slots=True)
class BranchPoint:
    """A recorded instant, and what is known of its run before it is reached."""

    recording: Recording
    time: float
    """s, robot's clock, as asked for."""
    description: RobotDescription
    is_simulated: bool


@dataclass(frozen=True, slots=True)
class Branch:
    """A recorded instant that was reached."""

    memory: SupervisorMemory
    """Memory of the control stack, for the policy that goes on."""
    inputs: RecordedInputs
    """Inputs of the recorded run from then on."""
    velocity: FloatArray | None
    """Shape (3,), the velocity command of that instant, if there was one."""
    notices: tuple[str, ...]


def open_branch(config: PlayConfig) -> BranchPoint:
    """Find the run, and the robot that it ran on; the options have the recorded ones in the place of defaults.

    Raises `InputError` if it is not a run of `play`, or a branch itself.
    """
    path, time = parse_branch(config.branch or "")
    recording = open_recording(path)
    header = recording.header
    if START_DOCUMENT in header.documents:
        raise InputError(f"--branch: '{path}' is a branch itself, expected the recording that it began in")
    settings = recorded_settings(path, header)
    if not str(settings.get("program", "")).startswith("humanoid_sim.play"):
        raise InputError(f"--branch: '{path}' is not of play, expected a recording of play")
    description = RobotDescription.from_json(header.documents.get("robot", ""), load_robot(config.robot).folder)
    return BranchPoint(recording, time, description, settings["options"].get("hardware") is None)


def reach(
    point: BranchPoint, setup: RobotSetup, supervisor: Supervisor, contract: PolicyContract, clock: Callable[[], float]
) -> Branch:
    """Advance a simulated robot, just built, and the control stack to the instant.

    The supervisor, the policy's contract and the robot's clock, s, are those of the run that goes on. Raises
    `InputError` if the recording has no such instant, or cannot be simulated again.
    """
    robot = setup.robot
    if not isinstance(robot, MujocoRobot):
        raise TypeError("only a simulation can branch")
    memory, stack, recorded, record, entries = _repeated(point, setup, robot if point.is_simulated else None)
    _check_measured(recorded, contract)
    state = record.input.state
    mode = memory.controller.removesuffix("_controller")
    notices = [f"branches at {float(state.time):g} s from {point.recording.path.name}, in {mode}"]
    if point.is_simulated:
        _compare(point, record, robot)
    else:
        notices.append(_as_measured(point, robot, record, memory))
    kept, notice = _for_policy(memory, stack, supervisor, record)
    inputs = RecordedInputs(
        chain([record], entries),
        point.recording.header.control_period,
        clock,
        measured=(*robot.extern, GRAVITY_LEVERS),
        repeats_safety=point.is_simulated,
    )
    velocity = state.extern.get(VELOCITY_COMMAND)
    return Branch(kept, inputs, None if velocity is None else np.array(velocity.value), (*notices, notice))


def _check_measured(recorded: PolicyContract | None, contract: PolicyContract) -> None:
    """Check that the simulated robot measures what the recorded policy needed."""
    anchor = "" if recorded is None else recorded.anchor_body
    points = () if recorded is None else recorded.velocity_points
    if contract.anchor_body and contract.anchor_body != anchor:
        raise InputError(
            f"--branch: the policy needs the pose of '{contract.anchor_body}', "
            f"the recorded run measured {repr(anchor) if anchor else 'none'}"
        )
    if missing := [name for name in contract.velocity_points if name not in points]:
        raise InputError(
            f"--branch: the policy needs the velocity of {', '.join(missing)}, which the recorded run did not measure"
        )
    if contract.height_scan not in (None, None if recorded is None else recorded.height_scan):
        raise InputError("--branch: the policy needs a height scan that the recorded run did not make")


def _repeated(
    point: BranchPoint, setup: RobotSetup, robot: MujocoRobot | None
) -> tuple[SupervisorMemory, Supervisor, PolicyContract | None, TickRecord, Iterator[Entry]]:
    """Repeat the run up to the instant, and simulate it where there is a robot.

    Returns:
        The stack's memory before its tick, the stack, the contract of its policy, that tick, and what follows it.
    """
    path, header = point.recording.path, point.recording.header
    tolerance = 0.5 * header.control_period
    policy, entries = RecordedPolicy(), _known_entries(point)
    contract, stack = recorded_contract(header), rebuild_supervisor(header, policy)
    setup.measure(contract)()
    memory, record = stack.initial(), None
    mode: Mode | None = None
    following, is_fresh = 0, False
    for entry in entries:
        if not isinstance(entry, TickRecord):
            if entry.kind is EventKind.FRESH_START:
                is_fresh = True
                setup.robot.activate()
            elif entry.kind is EventKind.POLICY:
                header = point.recording.loaded(entry)
                contract, stack = recorded_contract(header), rebuild_supervisor(header, policy)
                setup.measure(contract)()
            continue
        record = entry
        if is_fresh:
            memory, is_fresh = stack.initial(start_reason(record.output.control_mode.status_message)), False
        if record.index != following:
            missing = record.index - following
            raise InputError(f"--branch: '{path}' lacks {missing} ticks before tick {record.index}")
        time = float(record.input.state.time)
        if following == 0 and point.time < time - tolerance:
            raise InputError(f"--branch: {point.time:g} s is before the recording's begin, {time:g} s")
        if time > point.time - tolerance:
            return memory, stack, contract, record, entries
        following += 1
        if robot is not None:
            _compare(point, record, robot)
        policy.expect(record.output)
        memory, output = stack.step(memory, record.input)
        difference = first_difference(header, record.output, output)
        if difference is not None:
            raise InputError(f"--branch: '{path}' cannot be repeated: tick {record.index}: {difference}")
        if robot is not None:  # as the loop did: the support first
            before, mode = mode, record.output.control_mode.mode
            if mode is not before and robot.description.is_floating:
                support_in_mode(robot, mode)
            robot.write(record.output.command)
    end = "no ticks" if record is None else f"up to {float(record.input.state.time):g} s"
    raise InputError(f"--branch: {point.time:g} s is behind the end of '{path}', which has {end}")


def _known_entries(point: BranchPoint) -> Iterator[Entry]:
    """Yield what is recorded. Raises `InputError` for a push of an operator, if it would have to be simulated again."""
    until = point.time - 0.5 * point.recording.header.control_period if point.is_simulated else -math.inf
    for entry in point.recording.entries():
        if isinstance(entry, Event) and entry.kind is EventKind.PUSH and entry.time < until:
            path, at = point.recording.path, f"{entry.time:g} s"
            raise InputError(f"--branch: '{path}' has a push of an operator at {at}; expected no later instant")
        yield entry


def _compare(point: BranchPoint, record: TickRecord, robot: MujocoRobot) -> None:
    if record.index == 0:  # a run that was reset goes on by the clock of the one before
        robot.begin_clock(float(record.input.state.time))
    difference = state_difference(point.recording.header, record.input.state, robot.read()[0])
    if difference is not None:
        place = f" of {difference.where}" if difference.where else ""
        raise InputError(
            f"--branch: '{point.recording.path}' cannot be simulated again: tick {record.index} "
            f"({float(record.input.state.time):g} s): {difference.field}{place} was {difference.recorded}, "
            f"is {difference.replayed}; expected the same robot, and the MuJoCo and the machine that it was made with"
        )


def _as_measured(point: BranchPoint, robot: MujocoRobot, record: TickRecord, memory: SupervisorMemory) -> str:
    """Put the simulated robot where the real one was measured; names what nobody measured."""
    names, state = point.recording.header.joint_names, record.input.state
    for what, values in (("position", state.joint_position), ("velocity", state.joint_velocity)):
        silent = [name for name, value in zip(names, values, strict=True) if not math.isfinite(value)]
        if silent:
            raise InputError(f"--branch: the {what} of {', '.join(silent)} was not known at {float(state.time):g} s")
    has_imu = bool(np.isfinite(state.imu_quaternion).all())
    quaternion = state.imu_quaternion if has_imu else np.array([1.0, 0.0, 0.0, 0.0])
    robot.begin_at(float(state.time), state.joint_position, state.joint_velocity, quaternion)
    unknown = ["contacts", "forces from outside", "what the motors were about to do"]
    if robot.description.is_floating:
        unknown.insert(0, "place and motion of the base")
        if memory.controller in (RL_POLICY, REMOTE_POLICY):
            robot.set_support(False)
    return (
        f"joints as measured on the robot; unknown: {', '.join(unknown)}, so it goes on differently than the robot did"
    )


def _for_policy(
    memory: SupervisorMemory, recorded: Supervisor, supervisor: Supervisor, record: TickRecord
) -> tuple[SupervisorMemory, str]:
    """Return the memory for the policy that goes on, and what it means for it."""
    before, after = recorded.controllers.get(RL_POLICY), supervisor.controllers[RL_POLICY]
    own = memory.controller_memory
    if not (isinstance(own, RLPolicyMemory) and isinstance(before, RLPolicyController)):
        return memory, ""
    if not isinstance(after, RLPolicyController):
        raise TypeError("LOCOMOTION is not a policy's")
    held = own.held_ticks if before.decimation == after.decimation else after.decimation
    policy, notice = own.policy, ""
    if _remembered(before) != _remembered(after):
        frame = after.reference.clamp(own.policy.frame)
        policy = replace(after.wiring.activate(record.input.state), frame=frame)
        notice = (
            "this policy observes or moves something else than the recorded one: its history and its last action "
            f"begin anew, its reference at frame {int(frame)}"
        )
    elif after.reference.frame_count != before.reference.frame_count:
        policy = replace(policy, frame=after.reference.clamp(policy.frame))
    return replace(memory, controller_memory=replace(own, policy=policy, held_ticks=held)), notice


_REMEMBERED = (
    *("observation", "history_layout", "joint_names", "action_joint_names"),
    *("command_names", "align_reference", "anchor_body", "phase"),
)
"""Fields of a contract that say what a policy's memory means: with the same of these it fits another policy."""


def _remembered(controller: RLPolicyController) -> tuple[object, ...]:
    document, layout = parse_json(encode(controller.contract)), controller.wiring.layout
    return layout.step_width, layout.history, *(document[name] for name in _REMEMBERED)
