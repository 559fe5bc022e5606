"""One motor, enabled for a moment and stopped for certain."""

from __future__ import annotations

from typing import Self

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.cli.client import MotorClient
from humanoid_sim.hardware.cli.exchange import any_status, read_value, write_value
from humanoid_sim.hardware.robstride.faults import MotorMode, flag_names
from humanoid_sim.hardware.robstride.messages import Enable, OperationControl, Reply, Status, Stop
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, CanTimeout

__all__ = ["EnabledMotor"]

_CAN_TIMEOUT = 0.1
"""s after which the motor stops by itself if this program does not."""
_OPERATION_MODE = 0


class EnabledMotor:
    """A context in which a motor executes commands; it is limp at first, and stopped at the end whatever happens."""

    def __init__(self, client: MotorClient, motor_id: int) -> None:
        """Nothing is sent yet; the client must know the motor's model."""
        self._client = client
        self._motor_id = motor_id
        self._who = f"motor {motor_id} on {client.address}"
        self._old_timeout: float | None = None
        self.status: Status | None = None
        """The latest."""

    def __enter__(self) -> Self:
        """Enable the motor.

        Raises:
            SilentMotorError: it does not answer.
            RobotError: it is in another run mode, has no CAN timeout, or reports a fault.
        """
        client, motor_id = self._client, self._motor_id
        mode = read_value(client, motor_id, PARAMETERS["run_mode"])
        if mode != _OPERATION_MODE:
            raise RobotError(
                f"{self._who}: run_mode is {mode:g}, in which enabling may move it; set run_mode 0 first"
                if mode is not None
                else f"{self._who}: does not tell its run_mode"
            )
        self._old_timeout = read_value(client, motor_id, PARAMETERS["canTimeout"])
        try:
            write_value(client, motor_id, PARAMETERS["canTimeout"], CanTimeout.to_ticks(_CAN_TIMEOUT))
            # Whatever it was last told to do must not be what it begins with.
            client.require(OperationControl(motor_id, 0.0, 0.0, 0.0, 0.0, 0.0), any_status)
            self.status = client.require(Enable(motor_id, host_id=client.host_id), _enabled_or_faulty)
            self._check(self.status)
        except BaseException:
            self._stop()
            raise
        return self

    def command(self, position: float, velocity: float, stiffness: float, damping: float) -> Status:
        """Send a command in the motor frame: rad, rad/s, N·m/rad, N·m·s/rad; the status that follows.

        Raises:
            SilentMotorError: none follows.
            RobotError: the motor is no longer enabled, or reports a fault.
        """
        command = OperationControl(self._motor_id, position, velocity, 0.0, stiffness, damping)
        self.status = self._client.require(command, any_status)
        self._check(self.status)
        return self.status

    def _check(self, status: Status) -> None:
        if status.faults:
            raise RobotError(f"{self._who}: reports {', '.join(flag_names(status.faults))}")
        if status.mode is not MotorMode.RUN:
            raise RobotError(f"{self._who}: is in mode {status.mode.name.lower()}, expected run")

    def _stop(self) -> None:
        """Stop the motor, verify it, and give it its CAN timeout back."""
        client = self._client
        stopped = client.ask(Stop(self._motor_id, host_id=client.host_id), _stopped, attempts=5)
        if stopped is None:
            raise RobotError(
                f"{self._who}: does not confirm that it stopped; without commands it stops by itself after "
                f"{1000.0 * _CAN_TIMEOUT:g} ms; if it does not, switch its power off"
            )
        if self._old_timeout is not None:
            write_value(client, self._motor_id, PARAMETERS["canTimeout"], self._old_timeout)

    def __exit__(self, *_: object) -> None:
        self._stop()


def _enabled_or_faulty(reply: Reply) -> Status | None:
    """A late status of the stopped motor answers nothing."""
    return reply if isinstance(reply, Status) and (reply.mode is MotorMode.RUN or reply.faults) else None


def _stopped(reply: Reply) -> Status | None:
    return reply if isinstance(reply, Status) and reply.mode is MotorMode.RESET else None
