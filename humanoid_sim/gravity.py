"""Gravity compensation: a producer for REMOTE with a model of its own, as an outside System 1 would have it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import SessionError
from humanoid_sim.frontends.attach import attached, ready
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import GravityTorque

GravityForm = Literal["effort", "pd"]

_DAMPING = 1.0  # N·m·s/rad of the effort form: so much that an arm that is let go comes to rest
_TIMEOUT = 0.5  # s that a tick is waited for


def gravity_command(
    description: RobotDescription, position: FloatArray, gravity: FloatArray, form: GravityForm
) -> MITCommand:
    """Return the command that holds a pose against gravity.

    `effort`: the torque itself, K_p 0, a small K_d. `pd`: no feed-forward but the pose
    offset by `gravity / K_p`, with the robot's own gains, so that the spring carries the load.

    Args:
        description: the robot's own gains.
        position: shape (n,), rad.
        gravity: shape (n,), N·m, the torque that holds `position`, within the effort limits.
    """
    zeros = np.zeros_like(position)
    if form == "effort":
        return MITCommand(position, zeros, gravity, zeros, np.full_like(position, _DAMPING))
    stiffness = description.stiffness
    return MITCommand(position + gravity / stiffness, zeros, zeros, stiffness, description.damping)


class GravityProducer:
    """From ticks to commands.

    The PD form holds the pose of the first state after each entry into REMOTE, the effort form whatever pose the arms
    are in.
    """

    def __init__(self, description: RobotDescription, model: mujoco.MjModel, form: GravityForm) -> None:
        self._description, self._gravity = description, GravityTorque(description, model)
        self._form: GravityForm = form
        self._hold: FloatArray | None = None

    def command(self, record: TickRecord) -> MITCommand | None:
        """Return what to send after a tick; None while the position of a joint is not known."""
        position = record.input.state.joint_position
        if not np.isfinite(position).all():
            return None
        if self._form == "pd":
            is_remote = record.output.control_mode.mode is Mode.REMOTE
            self._hold = (position if self._hold is None else self._hold) if is_remote else None
            position = position if self._hold is None else self._hold
        return gravity_command(self._description, position, self._gravity(position), self._form)


@dataclass(frozen=True)
class GravityConfig:
    """Compensate gravity in REMOTE, on a running session."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    form: GravityForm = "effort"
    """Form of the command: feed-forward effort, or a PD position offset."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(GravityConfig, "gravity", arguments)
    with attached(config.session, "gravity") as attachment:
        producer = GravityProducer(attachment.description, attachment.model(), config.form)
        ready(f"gravity compensation ({config.form}) for {attachment}")
        while attachment.is_running():
            for tick in attachment.ticks(_TIMEOUT)[-1:]:
                command = producer.command(tick.record)
                if command is None:
                    continue
                try:
                    attachment.send(command, tick.stamp)
                except SessionError:  # it has ended
                    return 0
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
