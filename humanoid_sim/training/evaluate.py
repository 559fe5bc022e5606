"""Closed-loop tracking through the same stack as in deployment: supervisor, policy controller, simulated robot.

The baseline is inverse kinematics: the joint positions of the frame, exact to a fraction of a millimetre, sent as
position commands through the same controller, gains and robot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.errors import HumanoidSimError
from humanoid_sim.evaluation.tracking import TrackingErrors, TrackingSummary
from humanoid_sim.messages import Intent, Mode, TickInput, TickOutput
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import Motion, body_poses
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.stack import build_supervisor
from humanoid_sim.training.inverse_kinematics import InverseKinematics

__all__ = ["Rollout", "TrackingFailedError", "follow", "inverse_kinematics_policy"]

_STANDBY_TIMEOUT = 60.0
"""s"""


class TrackingFailedError(HumanoidSimError):
    """The policy did not get to the end of the motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Rollout:
    """One run of a policy along a motion."""

    summary: TrackingSummary
    command_rate: float
    """rad/s, root mean square over joints of the change of the commanded position from one policy step to the next."""
    fastest_joint: float
    """rad/s, the largest joint speed at a control tick in LOCOMOTION."""
    joint_position: FloatArray
    """Shape (F, n), rad, at the policy steps."""


def follow(
    description: RobotDescription,
    contract: PolicyContract,
    policy: Policy,
    motion: Motion,
    *,
    extra_time: float = 0.0,
    command_delay: float = 0.0,
    as_on_bus: bool = False,
) -> Rollout:
    """Walk a simulated robot through standby A into the policy, and measure until the motion's last frame.

    Args:
        description: the robot; control rates and physics step are its own.
        contract: of the policy.
        policy: the callable.
        motion: to follow.
        extra_time: s that the last frame is held, and measured, beyond the motion.
        command_delay: s, of the simulated motors.
        as_on_bus: time it as on the real robot: its hardware's control rate, and states as old as the last command.

    Raises:
        InputError: if robot, policy and motion do not fit together.
        TrackingFailedError: if the robot leaves LOCOMOTION before the end.
    """
    loaded = load_policy(contract, policy, motion)
    errors = TrackingErrors(description, motion.frames, contract.body_names, contract.policy_dt)
    wanted = len(motion.frames) + round(extra_time / contract.policy_dt)
    positions, commands, fastest = [], [], 0.0
    for tick_input, output in _ticks(description, loaded, command_delay, as_on_bus):
        if output.control_mode.mode is not Mode.LOCOMOTION:
            continue
        fastest = max(fastest, float(np.abs(tick_input.state.joint_velocity).max()))
        if output.policy_step is None:
            continue
        errors.update(output.policy_step.frame, tick_input.state.joint_position)
        positions.append(tick_input.state.joint_position)
        commands.append(output.command.position)
        if len(commands) == wanted:
            break
    rate = np.diff(np.array(commands), axis=0) / contract.policy_dt
    return Rollout(
        errors.summary(), float(np.sqrt((rate * rate).mean())) if len(rate) else 0.0, fastest, np.array(positions)
    )


def inverse_kinematics_policy(description: RobotDescription, contract: PolicyContract, motion: Motion) -> Policy:
    """A policy that commands the joint positions of the frame it is shown, solved beforehand.

    Raises:
        InputError: if the robot lacks one of the policy's bodies.
    """
    position, rotation = body_poses(motion.frames, len(contract.body_names))
    # Little damping: the poses can be reached, and the baseline is to be as good as it can.
    solver = InverseKinematics(description, contract.body_names, damping=1e-3)
    home = np.array(description.standby_controller_a.pose_segments[-1])
    path = solver.solve_path(position, rotation, home)
    driven = joint_indices(contract.action_joint_names, description.joint_names, "action_joint_names")
    default = contract.default_joint_pos[
        joint_indices(contract.action_joint_names, contract.joint_names, "joint_names")
    ]
    actions = ((path[:, driven] - default) / contract.action_scale).astype(np.float32)

    def policy(observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float32]:  # noqa: ARG001
        action: npt.NDArray[np.float32] = actions[frame]
        return action

    return policy


def _ticks(
    description: RobotDescription, loaded: LoadedPolicy, command_delay: float, as_on_bus: bool
) -> Iterator[tuple[TickInput, TickOutput]]:
    """The control loop of `play`, in simulated time and without end: DAMP, LOAD_A, START_LOCOMOTION."""
    period = 1.0 / (description.hardware if as_on_bus else description.simulation).control_frequency
    supervisor = build_supervisor(description, period, loaded)
    # MuJoCo's own actuators: the same law as on `qfrc_applied` to rounding, several times as fast.
    robot = MujocoRobot(
        description,
        control_period=period,
        actuation="affine",
        command_delay=command_delay,
        state_sampling="on_command" if as_on_bus else "now",
    )
    memory = supervisor.initial()
    intents = [Intent.DAMP, Intent.LOAD_A, Intent.START_LOCOMOTION]
    was_finished = True
    try:
        while True:
            state, safety = robot.read()
            due = (intents.pop(0),) if intents and was_finished else ()
            tick_input = TickInput(state, safety, due)
            memory, output = supervisor.step(memory, tick_input)
            robot.write(output.command)
            if not intents and output.control_mode.mode is not Mode.LOCOMOTION:
                raise TrackingFailedError(f"policy stopped at {state.time:.2f} s: {output.control_mode.status_message}")
            if intents and state.time > _STANDBY_TIMEOUT:
                raise TrackingFailedError(
                    f"no LOCOMOTION within {_STANDBY_TIMEOUT:g} s: {output.control_mode.status_message}"
                )
            was_finished = output.standby is None or output.standby.is_finished
            yield tick_input, output
    finally:
        robot.close()
