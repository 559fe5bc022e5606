"""Session with a robot's Sito motors: listen, enable, watch and disable them.

The protocol has no question and no answer. A motor sends nothing before it is enabled, and then by its own clock;
whether it accepted a command shows in its feedback only.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.channel import NEVER, Channel, Note
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.bus.open_channels import ChannelNotes, OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.guardian.guardian import SOURCE, Guardian, can_share
from humanoid_sim.hardware.guardian.protocol import GuardedMotor, GuardianPlan
from humanoid_sim.hardware.motor_link import Finding, LinkTerms, MotorGroup, MotorLink, Readings
from humanoid_sim.hardware.sito.codec import (
    FROM_MOTOR,
    LARGEST_INTERVAL,
    Feedback,
    Malformed,
    MessageType,
    Mode,
    PositionFeedback,
    SelectMode,
    SitoEncoder,
    damping_frames,
    decode,
    encode,
    limp_frames,
    reset_frames,
    split_identifier,
)
from humanoid_sim.messages import SafetyFlag, SafetyStatus
from humanoid_sim.mit import FloatArray

_LISTENING = 0.3
"""s in which a motor that is enabled, or another host, would be heard: feedback comes every 255 ms at the latest."""
_FIRST_FEEDBACK = 0.5
"""s at most from enabling to the first feedback of both kinds."""
_WATCH = 0.1
"""s in which feedback is watched before anything is commanded."""
_STRAY_EFFORT = 0.5
"""N·m that a motor without gains or current may report: noise of the current's measurement, and no more."""
_ROUND = 0.02
"""s between two rounds of frames while feedback is awaited."""
_RESETS = 3
"""Rounds of resets: none is acknowledged."""
_SILENCE = 1.0
"""s at most in which feedback must end after a reset."""
_SIGN = 0.3
"""s at most in which a motor that is enabled sends feedback: on a busy computer it is noticed late."""
_POLL = 0.001
"""s"""
_TYPES = frozenset(int(kind) for kind in MessageType)


_Message = TypeVar("_Message", Feedback, PositionFeedback)


class _Heard(NamedTuple, Generic[_Message]):
    """Feedback of one kind, and when it came, s, robot's clock."""

    time: float
    value: _Message


@dataclass(slots=True)
class SitoSlot:
    """Data received from one motor. Written by one receiver thread, whole objects at a time."""

    motor: int
    feedback: _Heard[Feedback] | None = None
    position: _Heard[PositionFeedback] | None = None
    invalid: Note = NEVER
    reports: int = 0
    """Frames of feedback 1 and 2."""
    largest_effort: float = 0.0
    """N·m, of feedback since enabling began."""

    @property
    def heard(self) -> float:
        """s, robot's clock, when the older of the latest two frames came; -infinity before both have."""
        if self.feedback is None or self.position is None:
            return -np.inf
        return min(self.feedback.time, self.position.time)


class SitoMotors(MotorLink):
    """See `MotorLink`."""

    knows_positions = False

    def __init__(self, line: OpenChannels, motors: MotorGroup, terms: LinkTerms) -> None:
        """Send nothing yet; with no motors of the family it only tells what strangers are heard."""
        self._line = line
        self.motors = motors
        self.uids: Mapping[str, bytes] = {}
        self.slots = tuple(SitoSlot(i) for i in range(motors.count))
        self.interval = min(max(round(1000.0 * terms.control_period), 1), LARGEST_INTERVAL)
        """ms between two frames of one kind of feedback."""
        self._by_address = {(motors.channel[i], motors.motor_id[i]): slot for i, slot in enumerate(self.slots)}
        self._enabled: set[int] = set()
        self._terms = terms
        self._encoder = SitoEncoder(motors)
        self._guardian: Guardian | None = None
        self._watched: list[Channel] = []
        self._sent: list[int] = []

    # --- receiver threads

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        """See `MotorLink`: whether the identifier is a Sito's."""
        parts = split_identifier(frame)
        if parts is None:
            return False
        device_id, kind = parts
        notes, slot = self._line.notes[channel], self._by_address.get((channel, device_id))
        if slot is None:
            notes.add_stranger("frame of no motor of this robot", time)
        elif kind in FROM_MOTOR:
            self._take(notes, slot, frame, time)
        elif kind in _TYPES:
            name = MessageType(kind).name.lower().replace("_", " ")
            notes.intruder = Note(time, f"another host sends '{name}' to motor {device_id}")
        else:
            notes.add_stranger("unknown message type", time)
        return True

    def _take(self, notes: ChannelNotes, slot: SitoSlot, frame: Frame, time: float) -> None:
        match decode(frame, self.motors.model[slot.motor]):
            case Feedback() as feedback:
                slot.feedback = _Heard(time, feedback)
                slot.reports += 1
                slot.largest_effort = max(slot.largest_effort, abs(feedback.effort))
            case PositionFeedback() as position:
                slot.position = _Heard(time, position)
                slot.reports += 1
            case Malformed(reason=reason):
                slot.invalid = Note(time, reason)
            case _:
                notes.add_stranger("feedback of a kind that was not asked for", time)

    # --- activation

    def _send(self, motor: int, frames: Iterable[Frame]) -> None:
        self._channel(motor).send([(None, frame) for frame in frames])

    def _limp(self, motor: int) -> tuple[Frame, ...]:
        place = self.slots[motor].position
        position = 0.0 if place is None else place.value.position
        return limp_frames(self.motors.motor_id[motor], self.motors.model[motor], position)

    def _wait(self, duration: float, condition: Callable[[], bool] = lambda: False) -> None:
        """Wait for something, s at most, robot's clock."""
        clock = self._line.clock
        end = clock() + duration
        while not condition() and clock() < end:
            time.sleep(_POLL)

    def examine(self, checks: CheckList) -> None:
        """See `MotorLink`: listens only, for there is nothing to ask; another master ends it with a `RobotError`."""
        before = [slot.reports for slot in self.slots]
        self._wait(_LISTENING)
        self._line.check(checks)
        checks.refuse()
        for slot, count in zip(self.slots, before, strict=True):
            motor = slot.motor
            where = f"motor {self.motors.motor_id[motor]} on {self._line.sources[self.motors.channel[motor]]}"
            checks.passed(self.motors.names[motor], f"{where}, {self.motors.model[motor].name}: it cannot be asked")
            if slot.reports > count:
                checks.warn(self.motors.names[motor], "sends feedback: another program left it enabled; it is stopped")

    def make_ready(self, checks: CheckList) -> None:
        """See `MotorLink`: makes them limp and disables them."""
        self._start_guardian(checks)
        for i in self._reset(range(self.motors.count)):
            checks.warn(self.motors.names[i], "goes on sending feedback after a reset: whether it obeyed is not known")

    def enable(self, checks: CheckList) -> None:
        """See `MotorLink`: zero gains and zero current before selecting MIT mode and directly after it.

        Whether a disabled motor takes gains is not known, so the first feedback is watched: one that reports torque is
        a problem, and so is one that stays silent.
        """
        intervals = (self.interval, self.interval, 0)
        self._encoder = SitoEncoder(self.motors)
        for slot in self.slots:
            slot.feedback = slot.position = None
            slot.largest_effort = 0.0
        for i in range(self.motors.count):
            device_id, model = self.motors.motor_id[i], self.motors.model[i]
            limp = limp_frames(device_id, model)
            self._enabled.add(i)
            if self._guardian is not None:
                self._guardian.standby()
            self._send(i, [*limp, encode(SelectMode(device_id, Mode.MIT, intervals), model), *limp])
        self._stay_limp(max(_FIRST_FEEDBACK, 0.005 * self.interval), until_all_are_heard=True)
        self._stay_limp(_WATCH, until_all_are_heard=False)
        for slot in self.slots:
            name = self.motors.names[slot.motor]
            if not np.isfinite(slot.heard):
                kinds = " and ".join(
                    kind for kind, heard in (("velocity", slot.feedback), ("position", slot.position)) if heard is None
                )
                checks.problem(name, f"sends no {kinds} after it was enabled: is it there, with supply and this id?")
            elif slot.largest_effort > _STRAY_EFFORT:
                checks.problem(
                    name,
                    f"reports {slot.largest_effort:.2f} N·m although it was told zero gains and zero current: it does "
                    "not take them while it is disabled, or it is told by somebody else; it is disabled again",
                )
            else:
                checks.passed(name, f"enabled, limp, feedback every {self.interval} ms")

    def _stay_limp(self, duration: float, *, until_all_are_heard: bool) -> None:
        """Repeat what makes all motors limp for a time, s, robot's clock: no frame of it is acknowledged."""
        end = self._line.clock() + duration
        while self._line.clock() < end:
            if until_all_are_heard and all(np.isfinite(slot.heard) for slot in self.slots):
                return
            self._wait(_ROUND)
            for i in range(self.motors.count):
                self._send(i, self._limp(i))

    def stop(self, motors: Iterable[int]) -> dict[int, str]:
        """See `MotorLink`. Nothing confirms a reset: what counts is that feedback which came before ends.

        It proves nothing where the motor was silent before, or the resets did not leave.
        """
        motors = list(motors)
        if self._guardian is not None:
            if self._guardian.drives:
                self._line.forget_queues()
                self._guardian.release(confirmed=False)
            else:
                self._guardian.standby()
        down = {i: bool(self._channel(i).down) for i in motors}
        doubtful = {i for i in motors if i in self._enabled and not self._is_sending(i)}
        left = set(self._reset(motors))
        for i in motors:
            channel = self._channel(i)
            has_left = channel.flush(0.0) and bool(channel.down) == down[i]
            if i in self._enabled and (i in doubtful or not has_left):
                left.add(i)
            if i not in left:
                self._enabled.discard(i)
        return {i: "sends feedback" if self._is_sending(i) else "no feedback" for i in sorted(left)}

    def close(self) -> None:
        """See `MotorLink`."""
        if self._guardian is not None:
            self._guardian.release(confirmed=not self._enabled)
            self._guardian = None

    def _start_guardian(self, checks: CheckList) -> None:
        names, motors = ", ".join(self.motors.names), self.motors
        if not names or self._guardian is not None:
            return
        if not all(can_share(channel.address) for channel in self._line.channels):
            checks.warn(SOURCE, f"{names}: emulated in this process, with which they end; no guardian watches them")
            return
        plan = GuardianPlan(
            tuple(
                GuardedMotor(
                    motors.names[i],
                    self._channel(i).address,
                    damping_frames(motors.motor_id[i], motors.model[i], float(self._terms.damping[i])),
                    reset_frames(motors.motor_id[i], motors.model[i]),
                )
                for i in range(motors.count)
            )
        )
        try:
            self._guardian = Guardian(plan, self._line.locks)
        except RobotError as error:
            checks.problem(SOURCE, str(error))
            return
        self._watched = [
            channel for each in plan.channels for channel in self._line.channels if channel.address == each
        ]
        self._sent = [0 for _ in self._watched]
        text = f"damps {names} for {plan.damping_time:g} s, then resets them, when this program is silent"
        checks.passed(SOURCE, f"process {self._guardian.pid} {text}; {self._guardian.measures}")
        checks.warn(SOURCE, f"if it is killed as well, only the switch of their supply stops them: {names}")

    def _channel(self, motor: int) -> Channel:
        return self._line.channels[self.motors.channel[motor]]

    def _is_sending(self, motor: int) -> bool:
        """Return whether feedback comes."""
        before = self.slots[motor].reports
        self._wait(max(_SIGN, 0.003 * self.interval), lambda: self.slots[motor].reports > before)
        return self.slots[motor].reports > before

    def _reset(self, motors: Iterable[int]) -> tuple[int, ...]:
        """Make motors limp and disable them; those whose feedback goes on."""
        motors = list(motors)
        for number in range(_RESETS):
            if number:
                self._wait(0.001 * self.interval)
            for i in motors:
                self._send(i, reset_frames(self.motors.motor_id[i], self.motors.model[i]))
        for channel in {self.motors.channel[i] for i in motors}:
            self._line.channels[channel].flush(_SILENCE)
        end, quiet = self._line.clock() + _SILENCE, 0.003 * self.interval
        left = motors
        while left and self._line.clock() < end:
            before = {i: self.slots[i].reports for i in left}
            self._wait(quiet)
            left = [i for i in left if self.slots[i].reports > before[i]]
        return tuple(left)

    # --- control

    def readings(self) -> Readings:
        """See `MotorLink`: position and velocity come in two frames, and the older one gives the time."""
        return Readings(*np.array([_row(slot) for slot in self.slots]).reshape(-1, 5).T)

    @property
    def answers(self) -> int:
        """See `MotorLink`."""
        return sum(slot.reports for slot in self.slots)

    def findings(self, since: float) -> Iterator[Finding]:
        """See `MotorLink`: no frame that reports a fault is known."""
        for slot in self.slots:
            if slot.invalid.time >= since:
                yield Finding(slot.motor, SafetyFlag.INVALID_FRAME, slot.invalid.text)

    def status(self) -> SafetyStatus | None:
        """See `MotorLink`."""
        return None if self._guardian is None else self._guardian.status()

    def command(self, values: FloatArray) -> None:
        """See `MotorLink`.

        Without K_p the position says nothing, unless a lost frame has left the motor its old K_p: then, stay there.
        """
        guardian = self._guardian
        if guardian is not None and guardian.has_taken_over:
            return
        position = self.readings().position
        values = values.copy()
        values[0] = np.where((values[3] == 0.0) & np.isfinite(position), position, values[0])
        batches: list[list[tuple[Hashable, Frame]]] = [[] for _ in self._line.channels]
        for motor, kind, frame in self._encoder.encode(values):
            batches[self.motors.channel[motor]].append(((self.motors.names[motor], kind), frame))
        for channel, batch in zip(self._line.channels, batches, strict=True):
            if batch:
                channel.send(batch, 2.0 * self._terms.control_period)
        if guardian is not None:
            guardian.beat()
            for index, channel in enumerate(self._watched):
                if channel.counters.sent != self._sent[index]:
                    self._sent[index] = channel.counters.sent
                    guardian.count_sent(index)


def _row(slot: SitoSlot) -> tuple[float, ...]:
    feedback, position = slot.feedback, slot.position
    if feedback is None or position is None:
        return (np.nan,) * 5
    return slot.heard, position.value.position, feedback.value.velocity, feedback.value.effort, np.nan
