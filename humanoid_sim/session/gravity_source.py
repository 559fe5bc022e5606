"""An in-process System 1: gravity compensation, sent as remote commands from a thread and a model of its own.

It hears states and sends commands the way an outside program would: at its own rate, late by its own delay, through
the inbox that checks and stamps whatever arrives.
"""

from __future__ import annotations

import threading
from typing import Literal

import numpy as np

from humanoid_sim.messages import SessionHeader, TickRecord
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import RemoteInbox
from humanoid_sim.simulation.kinematics import GravityTorque

__all__ = ["GravityForm", "GravitySource", "gravity_command"]

GravityForm = Literal["effort", "pd"]

_DAMPING = 1.0
"""N·m·s/rad of the effort form: a touch, so that an arm that is let go comes to rest."""
_PERIOD = 0.005
"""s between two commands, well inside the 100 ms after which REMOTE counts them as stale."""


def gravity_command(
    description: RobotDescription, position: FloatArray, gravity: FloatArray, form: GravityForm
) -> MITCommand:
    """The command that holds a pose against gravity.

    `effort`: the torque itself, K_p 0, a small K_d. `pd`: no feed-forward but the pose
    offset by `gravity / K_p`, with the robot's own gains, so that the spring carries the load.

    Args:
        description: the robot's own gains.
        position: shape (n,), rad.
        gravity: shape (n,), N·m, the torque that holds `position`, within the effort limits.
        form: which of the two.
    """
    zeros = np.zeros_like(position)
    if form == "effort":
        return MITCommand(position, zeros, gravity, zeros, np.full_like(position, _DAMPING))
    stiffness = description.stiffness
    return MITCommand(position + gravity / stiffness, zeros, zeros, stiffness, description.damping)


class GravitySource(Sink):
    """Sink of states and source of commands, on a thread of its own."""

    def __init__(self, description: RobotDescription, inbox: RemoteInbox, form: GravityForm = "effort") -> None:
        """Build the model; the thread starts with the session.

        The PD form holds the pose of the first state after each entry into REMOTE, the effort form whatever pose the
        arms are in.
        """
        self._description = description
        self._inbox = inbox
        self._form: GravityForm = form
        self._gravity = GravityTorque(description)
        self._latest: TickRecord | None = None
        self._hold: FloatArray | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="gravity", daemon=True)
        self.error: Exception | None = None

    def start(self, header: SessionHeader) -> None:
        """Begin."""
        self._thread.start()

    def tick(self, record: TickRecord) -> None:
        """Hear a state."""
        self._latest = record

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _work(self) -> None:
        try:
            while not self._stop.wait(_PERIOD):
                record = self._latest
                if record is not None:
                    self._send(record)
        except Exception as error:  # reported by the program; REMOTE sees a silent source and damps
            self.error = error

    def _send(self, record: TickRecord) -> None:
        position = record.input.state.joint_position
        if not np.isfinite(position).all():
            return
        if self._form == "pd":
            remote = record.output.control_mode.controller_name == "remote_policy_controller"
            self._hold = (position if self._hold is None else self._hold) if remote else None
            position = position if self._hold is None else self._hold
        gravity = self._gravity(position)
        self._inbox.put(
            self._description.joint_names, gravity_command(self._description, position, gravity, self._form)
        )
