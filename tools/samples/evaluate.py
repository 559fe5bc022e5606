"""Closed-loop tracking through the same loop as in deployment: session, supervisor, policy controller, simulated robot.

The baseline is inverse kinematics: the joint positions of the frame, exact to a fraction of a millimetre, sent as
position commands through the same controller, gains and robot.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from humanoid_sim.assets import SAMPLE_POLICY, asset_path, policy_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.errors import HumanoidSimError, InputError
from humanoid_sim.evaluation.tracking import TrackingErrors, TrackingSummary
from humanoid_sim.files import whole_file
from humanoid_sim.messages import Intent, Mode, SessionHeader, TickOutput, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import Motion, body_poses, read_motion
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session
from humanoid_sim.session.sinks import Sink
from humanoid_sim.simulation.kinematics import InverseKinematics
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.stack import build_supervisor
from tools.samples import EvaluateConfig
from tools.samples.motions import pose_a
from tools.samples.random_motions import held_out_motions

__all__ = ["Rollout", "TrackingFailedError", "evaluate", "follow", "inverse_kinematics_policy"]

_STANDBY_TIMEOUT = 60.0
"""s until LOCOMOTION, at most."""


class TrackingFailedError(HumanoidSimError):
    """The policy did not get to the end of the motion."""


def evaluate(config: EvaluateConfig) -> int:
    """Measure, print, write; returns the exit status.

    Raises `InputError` if a file cannot be read or written, or does not fit the policy.
    """
    description = load_robot("lite")
    checkpoint = load_checkpoint(policy_path(config.policy or SAMPLE_POLICY))
    if checkpoint.contract.task_type != "tracking":
        raise InputError(f"{checkpoint.source}: task_type is {checkpoint.contract.task_type}, expected tracking")
    if config.random < 0 or config.seed < 0:
        raise InputError(f"--random and --seed: are {config.random} and {config.seed}, expected at least 0")
    files = [Path(name) for name in config.motion] or sorted(asset_path("motions").glob("*.mcap"))
    motions = [(file.stem, read_motion(file)) for file in files]
    motions += [
        (f"random {i}", motion) for i, motion in enumerate(held_out_motions(description, config.random, config.seed))
    ]
    console = Console()
    rows: list[dict[str, Any]] = []
    with console.status("") as status:
        for name, motion in motions:
            status.update(f"following {name}")
            try:
                rows += _measure(description, checkpoint, name, motion, config)
            except (InputError, TrackingFailedError) as error:
                raise InputError(f"{name}: {error}") from None
    console.print(_table(rows))
    if config.json:
        with whole_file(config.json) as file:
            file.write(json.dumps(rows, indent=1).encode())
    return 0


def _measure(
    description: RobotDescription, checkpoint: Checkpoint, name: str, motion: Motion, config: EvaluateConfig
) -> list[dict[str, Any]]:
    """Return the policy and the baseline on one motion; the errors are the hands'."""
    contract = checkpoint.contract
    load_policy(contract, checkpoint.policy, motion)  # a motion that does not fit is refused before it is solved
    baseline = inverse_kinematics_policy(description, contract, motion)
    figures = []
    for label, policy in (("policy", checkpoint.policy), ("ik", baseline)):
        rollout = follow(
            description, contract, policy, motion, command_delay=config.command_delay, as_on_bus=config.bus
        )
        hands = rollout.summary.hands
        figures.append(
            {
                "motion": name,
                "policy": label,
                "peak_hand_speed": rollout.summary.peak_speed,  # m/s, of the reference
                "position_rms": hands.position_rms,  # m, as the next
                "position_max": hands.position_max,
                "orientation_rms": hands.orientation_rms,  # rad, as the next
                "orientation_max": hands.orientation_max,
                "command_rate": rollout.command_rate,  # rad/s, root mean square
            }
        )
    return figures


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="hand tracking in closed loop")
    table.add_column("motion")
    table.add_column("policy")
    for heading in ("peak m/s", "rms cm", "max cm", "rms °", "max °", "command rad/s"):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(
            row["motion"],
            row["policy"],
            f"{row['peak_hand_speed']:.2f}",
            f"{100.0 * row['position_rms']:.2f}",
            f"{100.0 * row['position_max']:.2f}",
            f"{math.degrees(row['orientation_rms']):.2f}",
            f"{math.degrees(row['orientation_max']):.2f}",
            f"{row['command_rate']:.3f}",
            end_section=row["policy"] == "ik",
        )
    return table


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
        extra_time: s that the last frame is held beyond the motion, which counts for no error of it.
        command_delay: s, of the simulated motors.
        as_on_bus: time it as on the real robot: its hardware's control rate, and states as old as the last command.

    Raises:
        InputError: if robot, policy and motion do not fit together.
        TrackingFailedError: if the robot does not come to LOCOMOTION, or leaves it before the end.
    """
    loaded = load_policy(contract, policy, motion)
    errors = TrackingErrors(description, motion.frames, contract.body_names, contract.policy_dt)
    course = _Course(errors, len(motion.frames) + round(extra_time / contract.policy_dt))
    period = 1.0 / (description.hardware if as_on_bus else description.simulation).control_frequency
    # MuJoCo's own actuators: the same law as on `qfrc_applied` to rounding, several times as fast.
    robot = MujocoRobot(
        description,
        control_period=period,
        actuation="affine",
        command_delay=command_delay,
        state_sampling="on_command" if as_on_bus else "now",
    )
    longest = _STANDBY_TIMEOUT + course.wanted * contract.policy_dt
    session = Session(
        robot,
        build_supervisor(description, period, loaded),
        LoopSettings(period, realtime=False, simulated=True, duration=longest, damping_time=0.0),
        header=SessionHeader(description.name, description.joint_names, period, 0),
        intents=(course,),
        sinks=(course,),
    )
    failures = session.run().failures
    if failures or len(course.commands) < course.wanted:
        ended = "policy stopped" if course.finished else f"the motion did not end within {longest:g} s; the robot is"
        raise TrackingFailedError("; ".join(failures) or f"{ended} at {course.status}")
    rate = np.diff(np.array(course.commands), axis=0) / contract.policy_dt
    return Rollout(
        errors.summary(),
        float(np.sqrt((rate * rate).mean())) if len(rate) else 0.0,
        course.fastest_joint,
        np.array(course.joint_positions),
    )


class _Course(Sink):
    """Walks the robot into the policy as soon as each step allows it, and measures what the policy does there."""

    def __init__(self, errors: TrackingErrors, wanted: int) -> None:
        self.wanted = wanted
        """Policy steps to measure."""
        self.joint_positions: list[FloatArray] = []
        self.commands: list[FloatArray] = []
        self.fastest_joint = 0.0
        self.status = ""
        """Time, and what the stack said of its mode then."""
        self.finished = False
        """All is measured, or the policy has stopped."""
        self._errors = errors
        self._intents = [Intent.DAMP, Intent.LOAD_A, Intent.START_LOCOMOTION]

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return the next intent, once what the one before asked for is done."""
        ready = output is None or output.standby is None or output.standby.is_finished
        return (self._intents.pop(0),) if self._intents and ready else ()

    def tick(self, record: TickRecord) -> None:
        """Take a tick into account until enough policy steps are measured."""
        state, output = record.input.state, record.output
        if self.finished:
            return
        self.status = f"{state.time:.2f} s: {output.control_mode.status_message}"
        if output.control_mode.mode is not Mode.LOCOMOTION:
            self.finished = not self._intents
            return
        self.fastest_joint = max(self.fastest_joint, float(np.abs(state.joint_velocity).max()))
        if output.policy_step is not None:
            self._errors.update(output.policy_step.frame, state.joint_position)
            self.joint_positions.append(state.joint_position)
            self.commands.append(output.command.position)
            self.finished = len(self.commands) == self.wanted


def inverse_kinematics_policy(description: RobotDescription, contract: PolicyContract, motion: Motion) -> Policy:
    """Return a policy that commands the joint positions of the frame it is shown, solved beforehand.

    Raises `InputError` if the robot lacks one of the policy's bodies.
    """
    position, rotation = body_poses(motion.frames, len(contract.body_names))
    # Little damping: the poses can be reached, and the baseline is to be as good as it can.
    solver = InverseKinematics(description, contract.body_names, damping=1e-3)
    path = solver.solve_path(position, rotation, pose_a(description))
    driven = joint_indices(contract.action_joint_names, description.joint_names, "action_joint_names")
    default = contract.default_joint_pos[
        joint_indices(contract.action_joint_names, contract.joint_names, "joint_names")
    ]
    actions = ((path[:, driven] - default) / contract.action_scale).astype(np.float32)

    def policy(observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float32]:  # noqa: ARG001
        action: npt.NDArray[np.float32] = actions[frame]
        return action

    return policy
