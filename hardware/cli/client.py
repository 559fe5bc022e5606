"""A bench tool's end of one channel: questions to motors, and their answers."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Mapping
from typing import Self, TypeVar

from humanoid_sim.errors import HumanoidSimError, InputError, RobotError
from humanoid_sim.hardware.bus.address import BusAddress, parse_address
from humanoid_sim.hardware.bus.channel import Channel, OpenBus
from humanoid_sim.hardware.bus.events import BusEvent
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.bus.lock import ChannelLock
from humanoid_sim.hardware.bus.opening import open_bus
from humanoid_sim.hardware.robstride.codec import decode_reply, encode_command
from humanoid_sim.hardware.robstride.commands import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.messages import Command, DeviceId, Ignored, Malformed, Reply
from humanoid_sim.robots.motors import MOTORS, MotorModel

__all__ = ["MotorClient", "SilentMotorError", "open_client"]

_ANSWER_TIME = 0.2
"""s that a motor has to answer; it takes a millisecond, and a busy computer may take longer to notice."""
_ATTEMPTS = 3
_ANY_MODEL = MOTORS["rs-00"]
"""Of motors whose model is not known: it scales only the values of statuses, which are then not shown."""

Answer = TypeVar("Answer")


class SilentMotorError(HumanoidSimError):
    """A motor does not answer: the tool ends with a status of its own."""


def open_client(channel: str, motor_id: int, host_id: int) -> MotorClient:
    """A client for the tools that talk to one motor.

    Raises:
        InputError: the channel or an id is not one.
        RobotError: the channel is in use, or cannot be opened.
    """
    if not 1 <= motor_id <= LARGEST_MOTOR_ID:
        raise InputError(f"motor id: is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")
    return MotorClient(parse_address(channel), host_id=host_id)


class MotorClient:
    """Holds a channel for itself, as a session does, and talks to any motor on it."""

    def __init__(
        self,
        address: BusAddress,
        *,
        host_id: int,
        models: Mapping[int, MotorModel] | None = None,
        open_channel: OpenBus = open_bus,
    ) -> None:
        """Open the channel.

        Args:
            address: the channel.
            host_id: our own id, 0 to 255.
            models: of motors whose statuses are read, by id.
            open_channel: opens it.

        Raises:
            InputError: the host id is none.
            RobotError: the channel is in use by a session or another tool, or cannot be opened.
        """
        if not 0 <= host_id <= 0xFF:
            raise InputError(f"--host-id: is {host_id}, expected 0 to 255")
        self.address = address
        self.host_id = host_id
        self._models = dict.fromkeys(range(256), _ANY_MODEL) | dict(models or {})
        self._answers: queue.SimpleQueue[tuple[Reply, float]] = queue.SimpleQueue()
        self._lock = ChannelLock(address)
        try:
            self._channel = Channel(address, self._receive, open_bus=open_channel)
        except BaseException:
            self._lock.release()
            raise

    def _receive(self, frame: Frame, when: float) -> None:
        reply = decode_reply(frame, self._models, self.host_id)
        if not isinstance(reply, Ignored | Malformed):
            self._answers.put((reply, when))

    def set_model(self, motor_id: int, model: MotorModel) -> None:
        """Read this motor's statuses with this model's scales from here on."""
        self._models[motor_id] = model

    def model(self, motor_id: int) -> MotorModel:
        """The model whose scales a motor's values have here."""
        return self._models[motor_id]

    @property
    def trouble(self) -> str:
        """What the channel itself says about why nothing comes back; empty where it says nothing."""
        events = (self._channel.recent(event, 0.0) for event in (BusEvent.TX_FULL, BusEvent.DAMAGED))
        return self._channel.down or next((text for text in events if text), "")

    def send(self, command: Command) -> None:
        """Send a command and do not wait.

        Raises:
            RobotError: the channel is down.
        """
        if self._channel.down:
            raise RobotError(f"{self.address}: {self._channel.down}")
        self._channel.send([(None, encode_command(command, self._models[command.motor_id]))])

    def ask(
        self,
        command: Command,
        accept: Callable[[Reply], Answer | None],
        *,
        wait: float = _ANSWER_TIME,
        attempts: int = _ATTEMPTS,
    ) -> Answer | None:
        """Send a command and wait for its answer.

        Args:
            command: to one motor.
            accept: turns an answer of that motor into the result, or None if it is not the one wanted.
            wait: s, for each attempt.
            attempts: times to ask.

        Returns:
            The result; None if there is none.

        Raises:
            RobotError: the channel is down.
        """
        return self.ask_each({command.motor_id: command}, accept, wait=wait, attempts=attempts).get(command.motor_id)

    def require(self, command: Command, accept: Callable[[Reply], Answer | None]) -> Answer:
        """`ask` for an answer without which there is nothing to do.

        Raises:
            SilentMotorError: there is none.
            RobotError: the channel is down.
        """
        answer = self.ask(command, accept)
        if answer is None:
            raise self.silence(f"motor {command.motor_id}")
        return answer

    def silence(self, who: str) -> SilentMotorError:
        """The error for motors that do not answer."""
        trouble = self.trouble
        return SilentMotorError(f"{who} does not answer on {self.address}" + (f" ({trouble})" if trouble else ""))

    def ask_each(
        self,
        commands: Mapping[int, Command],
        accept: Callable[[Reply], Answer | None],
        *,
        wait: float = _ANSWER_TIME,
        attempts: int = _ATTEMPTS,
    ) -> dict[int, Answer]:
        """`ask` for several motors at once, by id; those that do not answer are left out."""
        found: dict[int, Answer] = {}
        for _ in range(attempts):
            missing = [command for motor_id, command in commands.items() if motor_id not in found]
            if not missing:
                break
            while not self._answers.empty():  # answers that came too late to their questions
                self._answers.get_nowait()
            for command in missing:
                self.send(command)
            deadline = time.monotonic() + wait
            while len(found) < len(commands) and (left := deadline - time.monotonic()) > 0.0:
                try:
                    reply, _when = self._answers.get(timeout=left)
                except queue.Empty:
                    break
                answer = accept(reply) if reply.motor_id in commands and reply.motor_id not in found else None
                if answer is not None:
                    found[reply.motor_id] = answer
        return found

    def poll(
        self, commands: Mapping[int, Command], accept: Callable[[Reply], Answer | None], *, wait: float
    ) -> dict[int, Answer]:
        """Ask several motors once, for what is asked again and again: the latest answers that have come, by id.

        Unlike `ask_each` it takes late answers to earlier questions as well: where a bus, or whoever emulates one,
        takes longer than `wait`, there is an old answer each time, and not none for ever.
        """
        for command in commands.values():
            self.send(command)
        found: dict[int, Answer] = {}
        deadline = time.monotonic() + wait
        while True:
            left = deadline - time.monotonic() if len(found) < len(commands) else 0.0
            try:
                reply, _when = self._answers.get(timeout=left) if left > 0.0 else self._answers.get_nowait()
            except queue.Empty:
                return found
            answer = accept(reply) if reply.motor_id in commands else None
            if answer is not None:
                found[reply.motor_id] = answer

    def heard_ids(self, wait: float) -> list[DeviceId]:
        """Whoever says its id within `wait` s, one id twice where two motors have been given the same one."""
        found = []
        deadline = time.monotonic() + wait
        while (left := deadline - time.monotonic()) > 0.0:
            try:
                reply, _when = self._answers.get(timeout=left)
            except queue.Empty:
                break
            if isinstance(reply, DeviceId):
                found.append(reply)
        return found

    def close(self) -> None:
        """Close the channel and let others have it. May be called twice."""
        self._channel.close()
        self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
