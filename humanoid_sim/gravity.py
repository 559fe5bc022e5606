"""Gravity compensation: a producer for REMOTE with a model of its own, as an outside System 1 would have it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

import numpy as np

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import SessionError
from humanoid_sim.frontends.attach import attached
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import GravityTorque

_DAMPING = 1.0  # N·m·s/rad of the effort form: an arm that is let go comes to rest
_TIMEOUT = 0.5  # s that a tick is waited for


@dataclass(frozen=True)
class GravityConfig:
    """Compensate gravity in REMOTE, on a running session."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    form: Literal["effort", "pd"] = "effort"
    """Form of the command: feed-forward effort, or a PD position offset."""


def gravity_command(
    description: RobotDescription, position: FloatArray, gravity: FloatArray, form: Literal["effort", "pd"]
) -> MITCommand:
    """Return the command that holds `position`, shape (n,), rad, against `gravity`, shape (n,), N·m.

    `effort`: the torque itself, K_p 0, a small K_d. `pd`: no feed-forward but the pose offset by `gravity / K_p`, with
    the robot's own gains, so that the spring carries the load.
    """
    zeros = np.zeros_like(position)
    if form == "effort":
        return MITCommand(position, zeros, gravity, zeros, np.full_like(position, _DAMPING))
    stiffness = description.stiffness
    return MITCommand(position + gravity / stiffness, zeros, zeros, stiffness, description.damping)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(GravityConfig, "gravity", arguments)
    with attached(config.session, "gravity") as attachment, suppress(SessionError):  # which says that it has ended
        description, torque = attachment.description, GravityTorque(attachment.description, attachment.model())
        print(f"gravity compensation ({config.form}) for {attachment}", flush=True)
        while attachment.is_running():
            for tick in attachment.ticks(_TIMEOUT)[-1:]:
                position = tick.record.input.state.joint_position
                if np.isfinite(position).all():
                    attachment.send(gravity_command(description, position, torque(position), config.form), tick.stamp)
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
