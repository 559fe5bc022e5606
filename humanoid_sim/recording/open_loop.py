"""What another policy would have commanded on the states of a recorded run: open loop, for it did not move the robot.

It begins with each LOCOMOTION of the run, as the recorded policy did, and remembers its own actions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.base import RL_POLICY, Fault
from humanoid_sim.controllers.rl_policy import RLPolicyController, RLPolicyMemory
from humanoid_sim.errors import InputError
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import mit_torque
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.recording.reader import Recording
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.stack import policy_controller, recorded_motion

TOLERANCE = 1e-4  # rad; other processors and builds of ONNX Runtime stay below it


@dataclass(slots=True)
class JointDifference:
    """Largest differences of one joint from the recorded run."""

    joint: str
    position: float = 0.0  # rad, of the commanded position
    torque: float = 0.0  # N·m, of the MIT law at the recorded position and velocity
    first_time: float | None = None  # s, robot's clock, at which positions first differ by more than the tolerance


@dataclass(slots=True)
class OpenLoopReport:
    """Comparison of a policy with the one that ran."""

    joints: list[JointDifference]
    ticks: int = 0
    """Ticks that were compared."""
    failure: str = ""
    """First reason why the other policy gave no command; empty if it never failed."""
    failure_time: float | None = None
    """s, robot's clock."""
    missing_ticks: int = 0
    """Ticks missing from the recording during LOCOMOTION; nothing after them is compared until the next one."""
    first_time: float | None = None
    """s, robot's clock, at which any joint first differs by more than the tolerance."""

    @property
    def is_same(self) -> bool:
        """True if something was compared, nothing is missing or failed, and no command differs."""
        return self.ticks > 0 and not self.failure and not self.missing_ticks and self.first_time is None


def compare_open_loop(recording: Recording, checkpoint: Checkpoint) -> OpenLoopReport:
    """Run a policy on a recording's inputs and compare its commands with the recorded ones.

    Raises `InputError` if the recording cannot be read or its robot, motion or live inputs are not the policy's.
    """
    description = RobotDescription.from_json(recording.header.documents.get("robot", ""))
    report = OpenLoopReport([JointDifference(joint) for joint in description.joint_names])
    controller: RLPolicyController | None = None
    memory: RLPolicyMemory | None = None
    is_stopped, following = False, 0
    for tick in recording.ticks():
        lost, following = tick.index - following, tick.index + 1
        if tick.output.control_mode.controller_name != RL_POLICY:
            memory, is_stopped = None, False
            continue
        if lost and memory is not None:
            report.missing_ticks, is_stopped = report.missing_ticks + lost, True
        if is_stopped:
            continue
        time = float(tick.input.state.time)
        if controller is None:
            controller = _controller(recording, checkpoint, description, tick)
        begun = controller.activate(tick.input) if memory is None else memory
        result = begun if isinstance(begun, Fault) else controller.update(begun, tick.input)
        if isinstance(result, Fault):
            is_stopped = True
            if not report.failure:
                report.failure, report.failure_time = result.message, time
            continue
        memory, command = result
        report.ticks += 1
        state, commands = tick.input.state, (tick.output.command, command)
        torques = [
            mit_torque(one, state.joint_position, state.joint_velocity, description.effort_limit) for one in commands
        ]
        positions = np.abs(commands[1].position - commands[0].position)
        for joint, position, torque in zip(report.joints, positions, np.abs(torques[1] - torques[0]), strict=True):
            joint.position, joint.torque = max(joint.position, float(position)), max(joint.torque, float(torque))
            if position > TOLERANCE and joint.first_time is None:
                joint.first_time = time
                report.first_time = time if report.first_time is None else report.first_time
    return report


def _controller(
    recording: Recording, checkpoint: Checkpoint, description: RobotDescription, first: TickRecord
) -> RLPolicyController:
    """Return the policy's controller on the recorded robot, with the run's motion and the live inputs of a tick."""
    motion = recorded_motion(recording.header) or checkpoint.motion
    if motion is None and checkpoint.contract.task_type != "locomotion":
        task = checkpoint.contract.task_type
        raise InputError(f"{checkpoint.source}: is a {task} policy and follows a motion; {recording.path} has none")
    live = {name: value.value.shape[-1] for name, value in first.input.state.extern.items()}
    loaded = checkpoint.with_motion(motion)
    return policy_controller(description, recording.header.control_period, loaded, live=live)
