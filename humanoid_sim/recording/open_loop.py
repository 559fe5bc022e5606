"""What another policy would have commanded on the states of a recorded run: open loop, for it did not move the robot.

It begins with each LOCOMOTION of the run, as the recorded policy did, and remembers its own actions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.base import RL_POLICY, Fault
from humanoid_sim.controllers.rl_policy import RLPolicyMemory
from humanoid_sim.errors import InputError
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
    ticks: int = 0  # that were compared
    failure: str = ""  # reason why the other policy gave no command, or why nothing more is compared; empty for none
    failure_time: float | None = None  # s, robot's clock

    @property
    def is_same(self) -> bool:
        """True if something was compared, nothing failed, and no command differs."""
        return self.ticks > 0 and not self.failure and all(joint.first_time is None for joint in self.joints)


def compare_open_loop(recording: Recording, checkpoint: Checkpoint) -> OpenLoopReport:
    """Run a policy on a recording's inputs and compare its commands with the recorded ones, up to its first failure.

    Raises `InputError` if the recording cannot be read or its robot, motion or live inputs are not the policy's.
    """
    description = RobotDescription.from_json(recording.header.documents.get("robot", ""))
    motion = recorded_motion(recording.header) or checkpoint.motion
    task = checkpoint.contract.task_type
    if motion is None and task != "locomotion":
        raise InputError(f"{checkpoint.source}: is a {task} policy and follows a motion; {recording.path} has none")
    report = OpenLoopReport([JointDifference(joint) for joint in description.joint_names])
    controller, memory, following = None, None, 0
    for tick in recording.ticks():
        state, recorded = tick.input.state, tick.output.command
        lost, following = tick.index - following, tick.index + 1
        if tick.output.control_mode.controller_name != RL_POLICY:
            memory = None
            continue
        if controller is None:
            live = {name: value.value.shape[-1] for name, value in state.extern.items()}
            loaded = checkpoint.with_motion(motion)
            controller = policy_controller(description, recording.header.control_period, loaded, live=live)
        begun: RLPolicyMemory | Fault = controller.activate(tick.input) if memory is None else memory
        if lost and memory is not None:
            begun = Fault(f"{lost} ticks are missing")
        result = begun if isinstance(begun, Fault) else controller.update(begun, tick.input)
        if isinstance(result, Fault):
            report.failure, report.failure_time = result.message, float(state.time)
            break
        memory, command = result
        report.ticks += 1
        at = state.joint_position, state.joint_velocity, description.effort_limit
        torques = mit_torque(command, *at) - mit_torque(recorded, *at)
        differences = np.abs([command.position - recorded.position, torques]).T.tolist()
        for joint, (position, torque) in zip(report.joints, differences, strict=True):
            joint.position, joint.torque = max(joint.position, position), max(joint.torque, torque)
            if position > TOLERANCE and joint.first_time is None:
                joint.first_time = float(state.time)
    return report
