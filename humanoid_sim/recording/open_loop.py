"""What another policy would have commanded on the states of a recorded run: open loop, for it did not move the robot.

It begins with each LOCOMOTION of the run, as the recorded policy did, and remembers its own actions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.base import RL_POLICY, Fault
from humanoid_sim.controllers.rl_policy import RLPolicyController, RLPolicyMemory
from humanoid_sim.errors import InputError
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import FloatArray, mit_torque
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.recording.reader import Recording
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.stack import policy_controller, recorded_contract, recorded_motion


@dataclass(frozen=True, slots=True)
class JointDifference:
    """Differences of one joint from the recorded run."""

    joint: str
    position_max: float
    """rad, of the commanded position."""
    position_rms: float
    torque_max: float
    """N·m, of the torque of the MIT law at the recorded position and velocity."""
    torque_rms: float
    action_max: float | None
    """Of the raw action; None where one of the two policies does not drive the joint."""
    first_time: float | None
    """s, robot's clock, at which the commanded positions first differ by more than the tolerance."""


@dataclass(frozen=True, slots=True)
class OpenLoopReport:
    """Comparison of a policy with the one that ran."""

    tolerance: float
    """rad"""
    ticks: int
    """Ticks that were compared."""
    steps: int
    """Inferences of the other policy."""
    joints: tuple[JointDifference, ...]
    failure: str
    """First reason why the other policy gave no command; empty if it never failed."""
    failure_time: float | None
    """s, robot's clock."""
    missing_ticks: int
    """Ticks missing from the recording during LOCOMOTION; nothing after them is compared until the next one."""

    @property
    def first_time(self) -> float | None:
        """Time at which any joint first differs by more than the tolerance, s, robot's clock."""
        return min((joint.first_time for joint in self.joints if joint.first_time is not None), default=None)

    @property
    def is_same(self) -> bool:
        """Something was compared, nothing is missing or failed, and no command differs by more than the tolerance."""
        return self.ticks > 0 and not self.failure and not self.missing_ticks and self.first_time is None


Row = Callable[[float, Mapping[str, FloatArray]], None]
"""Takes a tick's time, s, and by name, in robot's order, (n,), what both policies gave; NaN where there is none."""


class _Differences:
    """Largest and squared differences of an (n,) quantity."""

    def __init__(self, count: int) -> None:
        self.largest, self._squares, self._count = np.full(count, np.nan), np.zeros(count), 0

    def add(self, recorded: FloatArray, other: FloatArray) -> FloatArray:
        """Take one tick; returns the magnitudes."""
        difference = np.abs(other - recorded)
        self.largest = np.fmax(self.largest, difference)
        self._squares += difference**2
        self._count += 1
        return difference

    def rms(self) -> FloatArray:
        return np.sqrt(self._squares / max(self._count, 1))


def compare_open_loop(
    recording: Recording, checkpoint: Checkpoint, tolerance: float, row: Row | None = None
) -> OpenLoopReport:
    """Run a policy on a recording's inputs and compare its commands with the recorded ones.

    Raises `InputError` if the recording cannot be read or its robot, motion or live inputs are not the policy's.
    """
    header = recording.header
    description = RobotDescription.from_json(header.documents.get("robot", ""))
    limit, count = description.effort_limit, description.joint_count
    contract = recorded_contract(header)
    places = _places(description.joint_names, () if contract is None else contract.action_joint_names)
    own_places = _places(description.joint_names, checkpoint.contract.action_joint_names)
    position, torque, action = (_Differences(count) for _ in range(3))
    first = np.full(count, np.nan)
    controller: RLPolicyController | None = None
    memory: RLPolicyMemory | None = None
    is_stopped, following, ticks, steps, missing = False, 0, 0, 0, 0
    failure, failure_time = "", None
    for tick in recording.ticks():
        lost, following = tick.index - following, tick.index + 1
        if tick.output.control_mode.controller_name != RL_POLICY:
            memory, is_stopped = None, False
            continue
        if lost and memory is not None:
            missing, is_stopped = missing + lost, True
        if is_stopped:
            continue
        state, time = tick.input.state, float(tick.input.state.time)
        if controller is None:
            controller = _controller(recording, checkpoint, description, tick)
        begun = controller.activate(tick.input) if memory is None else memory
        result = begun if isinstance(begun, Fault) else controller.update(begun, tick.input)
        if isinstance(result, Fault):
            is_stopped = True
            failure, failure_time = (failure, failure_time) if failure else (result.message, time)
            continue
        memory, command = result
        commands = tick.output.command, command
        torques = [mit_torque(each, state.joint_position, state.joint_velocity, limit) for each in commands]
        inferred = tick.output.policy_step, memory.policy_step
        actions = [np.full(count, np.nan), np.full(count, np.nan)]
        for values, step, at in zip(actions, inferred, (places, own_places), strict=True):
            if step is not None:
                values[at] = step.action
        differs = position.add(commands[0].position, command.position) > tolerance
        first[differs & np.isnan(first)] = time
        torque.add(*torques)
        action.add(*actions)
        ticks, steps = ticks + 1, steps + (memory.policy_step is not None)
        if row is not None:
            pairs = {"position": [each.position for each in commands], "torque": torques, "action": actions}
            row(time, {f"{who}_{name}": pair[i] for name, pair in pairs.items() for i, who in enumerate(_WHO)})
    joints = tuple(
        JointDifference(joint, *map(float, numbers[:4]), *(None if np.isnan(x) else float(x) for x in numbers[4:]))
        for joint, *numbers in zip(
            description.joint_names,
            *(position.largest, position.rms(), torque.largest, torque.rms(), action.largest, first),
            strict=True,
        )
    )
    return OpenLoopReport(tolerance, ticks, steps, joints, failure, failure_time, missing)


_WHO = ("recorded", "other")


def _places(joints: tuple[str, ...], driven: tuple[str, ...]) -> list[int]:
    return [joints.index(name) for name in driven if name in joints]


def _controller(
    recording: Recording, checkpoint: Checkpoint, description: RobotDescription, first: TickRecord
) -> RLPolicyController:
    """Return the policy's controller on the recorded robot, with the run's motion and the live inputs of a tick."""
    motion = recorded_motion(recording.header)
    motion = checkpoint.motion if motion is None else motion
    if motion is None and checkpoint.contract.task_type != "locomotion":
        task = checkpoint.contract.task_type
        raise InputError(f"{checkpoint.source}: is a {task} policy and follows a motion; {recording.path} has none")
    loaded = checkpoint.with_motion(motion)
    live = {name: value.value.shape[-1] for name, value in first.input.state.extern.items()}
    return policy_controller(description, recording.header.control_period, loaded, live=live)
