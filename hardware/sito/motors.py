"""A robot's Sito motors: listen, enable, command and disable them.

The protocol has no question and no answer. A motor sends nothing before it is enabled, and then feedback by its own
clock; whether it accepted a command shows in its feedback only. A watchdog brakes them when this program is silent.
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.hardware.can_bus import NEVER, Frame, Note, OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motor_link import Finding, LinkTerms, Motor, MotorLink, Readings
from humanoid_sim.hardware.sito import protocol
from humanoid_sim.hardware.sito.protocol import (
    Command,
    Enable,
    Gains,
    MessageType,
    damping_frames,
    encode,
    reset_frames,
)
from humanoid_sim.hardware.sito.watchdog import SOURCE, Watchdog, WatchedMotor
from humanoid_sim.messages import SafetyFlag, SafetyStatus
from humanoid_sim.mit import FloatArray

_LISTENING = 0.3
"""s in which a motor that is enabled, or another host, is received: feedback comes every 255 ms at the latest."""
_FIRST_FEEDBACK = 0.5  # s at most from enabling to enough feedback
_ENOUGH = 6  # frames of feedback, three of each kind, that are checked before anything is commanded
_STRAY_EFFORT = 0.5  # N·m that a motor without gains or current may report: noise of the current's measurement
_ROUND = 0.02  # s between two rounds of frames while feedback is awaited
_SILENCE = 1.0  # s at most in which feedback must end after a reset
_LIFETIME = 2.0  # control periods after which a command that has not left never leaves


@dataclass(slots=True)
class _Slot:
    """Data received from one motor, NaN before the first; written by one receiver thread."""

    velocity_time: float = np.nan  # s, robot's clock
    position_time: float = np.nan
    position: float = np.nan
    velocity: float = np.nan
    effort: float = np.nan
    invalid: Note = NEVER
    reports: int = 0  # frames of feedback 1 and 2


class SitoMotors(MotorLink):
    """See `MotorLink`."""

    def __init__(self, line: OpenChannels, motors: Sequence[Motor], terms: LinkTerms) -> None:
        self._line, self.motors, self._terms = line, motors, terms
        self.slots = tuple(_Slot() for _ in motors)
        self._index = {(motor.channel, motor.motor_id): i for i, motor in enumerate(motors)}
        period = round(1000.0 * terms.control_period)
        self._interval = min(max(period, 1), protocol.LARGEST_INTERVAL)  # ms between two frames of one kind of feedback
        self._enabled: set[int] = set()
        self._watchdog: Watchdog | None = None
        self._sent: dict[int, int] = {}  # frames by channel, as of the latest beat
        self._stiffness = np.zeros(len(motors))  # as sent last

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        parts = protocol.split_identifier(frame)
        if parts is None:
            return False
        bus, index, kind = self._line.channels[channel], self._index.get((channel, parts[0])), parts[1]
        if index is None:
            bus.strangers["frame of no motor of this robot"] += 1
            return True
        slot = self.slots[index]
        match protocol.decode(frame, self.motors[index].model):
            case protocol.Feedback() as feedback:
                slot.velocity_time, slot.velocity, slot.effort = time, feedback.velocity, feedback.effort
                slot.reports += 1
            case protocol.PositionFeedback(position=position):
                slot.position_time, slot.position = time, position
                slot.reports += 1
            case None if kind in (MessageType.FEEDBACK_1, MessageType.FEEDBACK_2):
                slot.invalid = Note(time, f"feedback with data '{frame.data.hex(' ')}'")
            case None if kind not in set(MessageType):
                bus.strangers["unknown type"] += 1
            case _:
                name = MessageType(kind).name.lower().replace("_", " ")
                bus.intruder = Note(time, f"another host sends '{name}' to motor {parts[0]}")
        return True

    # --- activation

    def examine(self, checks: CheckList) -> None:
        if self.motors:
            self._wait(_LISTENING)
        self._line.check(checks)
        checks.refuse()
        for motor, slot in zip(self.motors, self.slots, strict=True):
            source = self._line.sources[motor.channel]
            checks.passed(motor.name, f"motor {motor.motor_id} on {source}, {motor.model.name}: it has no questions")
            if slot.reports:
                checks.warn(motor.name, "sends feedback: another program left it enabled; it is stopped")

    def make_ready(self, checks: CheckList) -> None:
        if self.motors and self._watchdog is None:
            self._start_watchdog(checks)
            checks.refuse()
        for i in self._reset(range(len(self.motors))):
            checks.warn(self.motors[i].name, "goes on sending feedback after a reset: whether it obeyed is not known")

    def _start_watchdog(self, checks: CheckList) -> None:
        plan, names = [], ", ".join(motor.name for motor in self.motors)
        for motor in self.motors:
            target, address = (motor.motor_id, motor.model), self._line.channels[motor.channel].address
            frames = damping_frames(*target, motor.damping), reset_frames(*target)
            plan.append(WatchedMotor(motor.name, address, *frames))
        if any(motor.channel.interface == "virtual" for motor in plan):
            checks.warn(SOURCE, f"{names}: mock motors of this process, with which they end; no watchdog")
            return
        with checks.collecting(SOURCE):
            self._watchdog = Watchdog(plan, [channel.lock.fileno() for channel in self._line.channels])
            checks.passed(SOURCE, f"process {self._watchdog.pid} damps and resets {names} when this program is silent")
            checks.warn(SOURCE, f"without it, or without the bus, only the switch of their supply stops {names}")

    def enable(self, checks: CheckList) -> None:
        """Send zero gains and zero current before selecting MIT mode and directly after it.

        Whether a disabled motor takes gains is not known: one that then reports torque, or is silent, is a problem.
        """
        if self._watchdog is not None:
            self._watchdog.enabled()
        for i, slot in enumerate(self.slots):
            slot.velocity_time = slot.velocity = slot.position_time = slot.position = np.nan
            slot.reports = 0
            motor, limp = self.motors[i], self._limp(i)
            self._enabled.add(i)
            self._send(i, [*limp, encode(Enable(motor.motor_id, self._interval), motor.model), *limp])
        self._stiffness[:] = 0.0
        end = self._line.clock() + max(_FIRST_FEEDBACK, 0.005 * self._interval)
        while self._line.clock() < end and any(slot.reports < _ENOUGH for slot in self.slots):
            self._wait(_ROUND)
            for i, slot in enumerate(self.slots):  # again and again: none is acknowledged
                self._send(i, self._limp(i, _here(slot, 0.0)))
        for (name, *_), slot in zip(self.motors, self.slots, strict=True):
            if np.isnan(slot.velocity + slot.position):
                missing = "velocity" if np.isnan(slot.velocity) else "position"
                checks.problem(name, f"sends no {missing} after it was enabled: is it there, with supply and this id?")
            elif abs(slot.effort) > _STRAY_EFFORT:
                text = f"reports {slot.effort:.2f} N·m with zero gains and zero current"
                checks.problem(name, f"{text}: it ignores them while it is disabled, or another host commands it")
            else:
                checks.passed(name, f"enabled, limp, feedback every {self._interval} ms")

    def _wait(self, duration: float) -> None:
        end = self._line.clock() + duration  # s; on the robot's clock, as mock motors may be slow
        while self._line.clock() < end:
            time.sleep(0.001)

    def _send(self, motor: int, frames: Iterable[Frame]) -> None:
        self._line.channels[self.motors[motor].channel].send([(None, frame) for frame in frames])

    def _limp(self, motor: int, position: float = 0.0) -> tuple[Frame, ...]:
        return damping_frames(self.motors[motor].motor_id, self.motors[motor].model, 0.0, position)

    # --- control

    def readings(self) -> Readings:
        rows = np.full((5, len(self.motors)), np.nan)
        for i, slot in enumerate(self.slots):
            older = np.minimum(slot.position_time, slot.velocity_time)  # NaN: not both have come
            rows[:, i] = older, slot.position, slot.velocity, slot.effort, np.nan
        return Readings(*rows)

    def findings(self, since: float) -> Iterator[Finding]:
        for motor, slot in zip(self.motors, self.slots, strict=True):
            if slot.invalid.time >= since:
                yield Finding(motor, SafetyFlag.INVALID_FRAME, slot.invalid.text)

    def status(self) -> SafetyStatus | None:
        return None if self._watchdog is None else self._watchdog.status()

    def command(self, values: FloatArray) -> None:
        """Send gains with every command, softer ones before it and stiffer ones after it.

        They have a frame of their own, which nothing acknowledges, and hold until others come: a lost one must not
        leave a motor stiff. Without stiffness the commanded position is where the motor is, for the same reason.
        """
        if self._watchdog is not None and not self._watchdog.poll():
            return
        batches: dict[int, list[tuple[Hashable, Frame]]] = {}
        for i, (position, velocity, effort, stiffness, damping) in enumerate(values.T.tolist()):
            motor = self.motors[i]
            goal = _here(self.slots[i], position) if stiffness == 0.0 else position
            command = ((i, "command"), encode(Command(motor.motor_id, goal, velocity, effort), motor.model))
            gains = ((i, "gains"), encode(Gains(motor.motor_id, stiffness, damping), motor.model))
            pair = [command, gains] if stiffness > self._stiffness[i] else [gains, command]
            self._stiffness[i] = stiffness
            batches.setdefault(motor.channel, []).extend(pair)
        for channel, batch in batches.items():
            self._line.channels[channel].send(batch, _LIFETIME * self._terms.control_period)
        sent = {channel: self._line.channels[channel].sent for channel in batches}
        if self._watchdog is not None and all(count != self._sent.get(i) for i, count in sent.items()):
            self._watchdog.beat()  # frames leave on every channel
            self._sent = sent

    # --- the end

    def stop(self, motors: Sequence[int]) -> dict[int, str]:
        """Disable motors; only feedback that came before and ends confirms it."""
        if self._watchdog is not None and motors:
            if self._watchdog.poll():
                self._watchdog.enabled()  # nothing is commanded from here on
            else:
                self._line.forget_queues()
                self.close()
        before = {i: self.slots[i].reports for i in motors if i in self._enabled}
        end = self._line.clock() + _LISTENING
        while left := {i: "no feedback" for i, count in before.items() if self.slots[i].reports == count}:
            if self._line.clock() >= end:
                break
            time.sleep(0.001)
        left |= dict.fromkeys(self._reset(motors), "sends feedback")
        self._enabled -= set(motors) - left.keys()
        return left

    def close(self) -> None:
        if self._watchdog is not None:
            self._watchdog.release(confirmed=not self._enabled)
            self._watchdog = None

    def _reset(self, motors: Iterable[int]) -> list[int]:
        """Make motors limp and disable them, until their feedback ends; returns those whose feedback goes on."""
        left, end = list(motors), self._line.clock() + _SILENCE
        while left and self._line.clock() < end:
            before = {i: self.slots[i].reports for i in left}
            for i in left:
                self._send(i, reset_frames(self.motors[i].motor_id, self.motors[i].model))
            self._wait(0.003 * self._interval)
            left = [i for i in left if self.slots[i].reports > before[i]]
        return left


def _here(slot: _Slot, otherwise: float) -> float:
    return otherwise if np.isnan(slot.position) else slot.position
