"""Questions to many motors at once, and their answers: one outstanding question per motor, asked again if need be."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from humanoid_sim.hardware.bus.channel import Channel
from humanoid_sim.hardware.robot.table import MotorTable, Sample
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.hardware.robstride.commands import encode_command
from humanoid_sim.hardware.robstride.messages import Command, DeviceId, GetDeviceId, Reply
from humanoid_sim.robots.motors import MOTORS

__all__ = ["Requests"]

_ANSWER_TIMES = (0.05, 0.1, 0.2, 0.4)
"""s that a motor has to answer each time that it is asked. It takes milliseconds; the first retries are for a lost
frame, the last for a busy computer."""
_POLL = 0.001
"""s"""

Answer = TypeVar("Answer")


class Requests:
    """Asks motors, while nothing is moving. Each call waits for its answers and never raises."""

    def __init__(self, wiring: Wiring, table: MotorTable, channels: Sequence[Channel], host_id: int) -> None:
        """Prepare; the table's inbox must be `collect` while this is in use."""
        self.wiring = wiring
        self.table = table
        self.host_id = host_id
        self._channels = channels
        self._answers: queue.SimpleQueue[tuple[int, Reply, float]] = queue.SimpleQueue()

    def collect(self, channel: int, reply: Reply, when: float) -> None:
        """Take an answer; called on receivers' threads."""
        self._answers.put((channel, reply, when))

    def send(self, commands: Mapping[int, Sequence[Command]]) -> None:
        """Send commands to motors by joint, those of one motor in order; motors take turns.

        Where an earlier round is still waiting to leave, this one takes its place.
        """
        longest = max((len(group) for group in commands.values()), default=0)
        for step in range(longest):
            for joint, group in commands.items():
                if step < len(group):
                    frame = encode_command(group[step], self.wiring.model[joint])
                    self._channels[self.wiring.channel[joint]].send([((type(group[step]), joint, step), frame)])

    def ask(
        self,
        commands: Mapping[int, Sequence[Command]],
        accept: Callable[[int, Reply], Answer | None],
    ) -> dict[int, Answer]:
        """Send each joint's commands and collect one answer per joint.

        Args:
            commands: by joint.
            accept: turns an answer from a joint's motor into the result, or None if it is not the one wanted.

        Returns:
            The results by joint; a motor that did not answer any attempt is left out.
        """
        found: dict[int, Answer] = {}
        by_address = {(self.wiring.channel[i], self.wiring.motor_id[i]): i for i in commands}
        for patience in _ANSWER_TIMES:
            missing = {joint: group for joint, group in commands.items() if joint not in found}
            if not missing:
                break
            self._drain()
            self.send(missing)
            deadline = time.monotonic() + patience
            while len(found) < len(commands) and (left := deadline - time.monotonic()) > 0.0:
                try:
                    channel, reply, _ = self._answers.get(timeout=left)
                except queue.Empty:
                    break
                joint = by_address.get((channel, reply.motor_id))
                if joint is None or joint in found:
                    continue
                answer = accept(joint, reply)
                if answer is not None:
                    found[joint] = answer
        return found

    def until_status(
        self, commands: Mapping[int, Sequence[Command]], wanted: Callable[[Sample], bool]
    ) -> dict[int, Sample]:
        """Send each joint's commands until a status that came afterwards is as wanted.

        What counts is the state that a motor reports and not that it answers: a late status to an earlier command, or
        an active report, answers nothing.

        Returns:
            The status by joint; a motor that did not report it after any attempt is left out.
        """
        found: dict[int, Sample] = {}
        for patience in _ANSWER_TIMES:
            missing = {joint: group for joint, group in commands.items() if joint not in found}
            if not missing:
                break
            before = {joint: self.table.slots[joint].sample for joint in missing}
            self.send(missing)
            deadline = time.monotonic() + patience
            while len(found) < len(commands) and time.monotonic() < deadline:
                time.sleep(_POLL)
                for joint, old in before.items():
                    sample = self.table.slots[joint].sample
                    if sample is not None and sample is not old and wanted(sample):
                        found[joint] = sample
        return found

    def received(self) -> list[tuple[int, Reply]]:
        """Joint and answer of every answer that has come since; waits for none."""
        by_address = {(self.wiring.channel[i], self.wiring.motor_id[i]): i for i in range(self.wiring.count)}
        found = []
        while not self._answers.empty():
            channel, reply, _ = self._answers.get_nowait()
            joint = by_address.get((channel, reply.motor_id))
            if joint is not None:
                found.append((joint, reply))
        return found

    def scan(self, motor_ids: Sequence[int], quiet_time: float) -> list[tuple[int, DeviceId]]:
        """Ask these ids on every channel who is there; every answer with its channel, also second ones of one id.

        Args:
            motor_ids: 1 to 127.
            quiet_time: s without an answer after which nobody else is expected.
        """
        self._drain()
        some_model = next(iter(MOTORS.values()))  # a question looks the same for every model
        frames = [encode_command(GetDeviceId(i, host_id=self.host_id), some_model) for i in motor_ids]
        for channel in self._channels:
            channel.send([(None, frame) for frame in frames])
        for channel in self._channels:
            channel.flush(1.0)
        found: list[tuple[int, DeviceId]] = []
        while True:
            try:
                channel_index, reply, _ = self._answers.get(timeout=quiet_time)
            except queue.Empty:
                return found
            if isinstance(reply, DeviceId):
                found.append((channel_index, reply))

    def _drain(self) -> None:
        """Forget answers that came too late to their questions."""
        while not self._answers.empty():
            self._answers.get_nowait()
