"""Motors under control: their joints' state and safety, commands to them, and how they are left."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from humanoid_sim.hardware.adapter.guarding import MotorGuard
from humanoid_sim.hardware.adapter.joint_tracking import JointReadings, JointTracker
from humanoid_sim.hardware.adapter.robot_motors import RobotMotors
from humanoid_sim.hardware.adapter.wiring import AdapterSettings, Wiring
from humanoid_sim.hardware.bus.events import BusEvent
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.families import DRIVERS
from humanoid_sim.hardware.motors import STOPPED, Finding
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand, MITState, bounded_position
from humanoid_sim.robots.motors import FAMILIES
from humanoid_sim.session.reactivation import HOW_TO_REACTIVATE
from humanoid_sim.session.rest import RestDetector

_WARNINGS = SafetyFlag.TX_QUEUE_OVERRUN | SafetyFlag.INVALID_FRAME
"""Flags that are a WARNING by themselves, as a finding without a flag is; the others are a FAULT."""
_SILENT = "silent"


class SafetyWatch:
    """Builds the statuses afresh at every reading, from what is observed then.

    What is a state is reported while it lasts: a channel that is down (until it is opened afresh), a silent joint, a
    fault that the latest status reports, a mode other than RUN, a position that has lost its meaning (until
    re-activation). What is an event is reported for the receive timeout after it happened, so that an operator and a
    20 ms tick see the same. Single bus errors are counted only: CAN sends the frame again, and what is lost all the
    same shows as a silent joint or a full queue. A burst of them, or a flood, has no flag of its own, and is a WARNING.

    Where nobody asked or commanded for longer than the CAN timeout, this program stood still: that explains joints that
    were not heard until now, and motors that have stopped without a fault.

    Messages hold no figures that change from tick to tick: a status is published when it changes.
    """

    def __init__(self, settings: AdapterSettings, motors: RobotMotors, *, since: float) -> None:
        """Begin to watch motors that were enabled at `since`, s, robot's clock; what happened before is past."""
        wiring = settings.wiring
        self._names = wiring.names
        self._motors = motors
        self._channels = channels = motors.line.channels
        self._joints = tuple(wiring.on_channel(index) for index in range(len(channels)))
        self._rx_timeout = settings.rx_timeout
        self._since = self._beat = since
        self._can_timeout = settings.can_timeout
        self._continued, self._standstill = -math.inf, 0.0
        """End and duration of this program's latest standstill, s."""
        self._stopped_by_it: set[int] = set()
        self._ok = tuple(SafetyStatus(source=source) for source in settings.sources)
        self.faults: Mapping[str, tuple[str, ...]] = {}
        """By joint, what the latest statuses say of its motor. A new one each time: other threads may look."""

    def beat(self, now: float) -> None:
        """Note a sign of life of this program, s, robot's clock."""
        if now - self._beat > self._can_timeout:
            self._continued, self._standstill = now, now - self._beat
        self._beat = now

    def statuses(self, now: float, age: FloatArray, tracker: JointTracker) -> tuple[SafetyStatus, ...]:
        """Return one status per channel at `now`, s, robot's clock; `age`: shape (n,), s since each joint was heard."""
        self.beat(now)
        recent = max(now - self._rx_timeout, self._since)
        silent = age > self._rx_timeout
        faults: dict[str, tuple[str, ...]] = {}
        statuses = tuple(self._status(index, recent, silent, tracker, faults) for index in range(len(self._channels)))
        self.faults = faults
        return statuses

    def _status(
        self,
        index: int,
        recent: float,
        silent: npt.NDArray[np.bool_],
        tracker: JointTracker,
        faults: dict[str, tuple[str, ...]],
    ) -> SafetyStatus:
        """Return the status of one channel; adds what it says of each joint to `faults`."""
        joints = self._joints[index]
        findings = [*self._bus(index, recent)]
        stood_still = self._continued >= recent
        unexplained: set[str] = set()
        for i in joints:
            own = [*self._motor(i, recent, tracker)]
            if silent[i]:
                own.insert(0, (SafetyFlag.RX_TIMEOUT, _SILENT, self._names[i]))
            if own:
                faults[self._names[i]] = told = tuple(dict.fromkeys(what for _, what, _ in own))
                findings += own
                if stood_still and STOPPED in told:
                    self._stopped_by_it.add(i)
                explained = {_SILENT: stood_still, STOPPED: i in self._stopped_by_it}
                unexplained.update(what for what in told if not explained.get(what))
        if not findings:
            return self._ok[index]
        flags = SafetyFlag.NONE
        for flag, _, _ in findings:
            flags |= flag
        level = SafetyLevel.FAULT if flags & ~_WARNINGS else SafetyLevel.WARNING
        words = _in_words(findings, len(joints))
        advice = _advice(flags, int(silent[list(joints)].sum()), len(joints))
        if any(name for _, _, name in findings) and not unexplained and not flags & SafetyFlag.BUS_OFF:
            advice = f"find out why this program stood still for {self._standstill:.1f} s"
        if advice:
            words = f"{words}; {advice}, then {HOW_TO_REACTIVATE}"
        return SafetyStatus(level, flags, self._ok[index].source, words)

    def _bus(self, index: int, recent: float) -> Iterator[Finding]:
        channel, notes = self._channels[index], self._motors.line.notes[index]
        if down := channel.down:
            yield SafetyFlag.BUS_OFF, f"down: {down}", ""
        if notes.flood.time >= recent:
            yield SafetyFlag.NONE, notes.flood.text, ""
        if text := channel.recent(BusEvent.TX_FULL, recent):
            yield SafetyFlag.TX_QUEUE_OVERRUN, text, ""
        if text := channel.recent(BusEvent.BURST, recent):
            yield SafetyFlag.NONE, text, ""
        if text := channel.recent(BusEvent.UNREADABLE, recent):
            yield SafetyFlag.INVALID_FRAME, text, ""
        if notes.intruder.time >= recent:
            yield SafetyFlag.INVALID_FRAME, notes.intruder.text, ""

    def _motor(self, joint: int, recent: float, tracker: JointTracker) -> Iterator[Finding]:
        name = self._names[joint]
        yield from self._motors.findings(joint, recent)
        if tracker.jumped[joint]:
            yield SafetyFlag.MOTOR_FAULT, "position jumped", name
        if tracker.wrapped[joint]:
            yield SafetyFlag.MOTOR_FAULT, "turned beyond ±4π", name


def _in_words(findings: Sequence[Finding], joint_count: int) -> str:
    """Each finding once with its joints: `silent: left_elbow_pitch, left_wrist_yaw`, or `silent: all 7 motors`.

    One that begins with `is` follows its joint: `left_elbow_pitch is too hot`.
    """
    joints: dict[str, dict[str, None]] = {}
    for _, what, name in findings:
        joints.setdefault(what, {})[name] = None
    words = []
    for what, names in joints.items():
        everyone = f"all {joint_count} motors" if 2 < joint_count == len(names) else ", ".join(names)
        if what.startswith("is "):
            words.append(f"{everyone} {what if len(names) == 1 else f'are {what[3:]}'}")
        else:
            words.append(f"{what}: {everyone}" if everyone else what)
    return "; ".join(words)


def _advice(flags: SafetyFlag, silent: int, joint_count: int) -> str:
    """Say what to do about a channel's flags before the robot is activated again; empty for what clears by itself."""
    if flags & SafetyFlag.BUS_OFF or 1 < silent == joint_count:
        return "check its cable, terminators and supply"
    if flags & SafetyFlag.RX_TIMEOUT:
        return "check its plug" if silent == 1 else "check their plugs"
    if flags & SafetyFlag.TEMPERATURE_LIMIT:
        return "let it cool"
    return "find the cause" if flags & SafetyFlag.MOTOR_FAULT else ""


_LIFETIME = 2.0
"""Control periods after which a command that has not left never leaves: by then there are newer ones, or none because
this process stood still."""
_BAD_COMMAND = SafetyStatus(
    SafetyLevel.CRITICAL, SafetyFlag.NONE, "host", "a command was not finite and was replaced by damping"
)


class MotorControl:
    """Control of the motors from one activation to the next. Nothing here waits or raises for what happens on a bus."""

    def __init__(self, settings: AdapterSettings, motors: RobotMotors, turns: FloatArray, guard: MotorGuard) -> None:
        """Begin with prepared motors and the `turns` of `find_turns`; commands are sent once the motors are enabled."""
        wiring = settings.wiring
        self._settings = settings
        self._motors = motors
        self._guard = guard
        self._tracker = JointTracker(wiring, turns)
        self._warmest = np.full(wiring.count, np.nan)
        self._joints = self.read()
        self._watch: SafetyWatch | None = None
        self._bad_command = -math.inf
        self.encoder = CommandEncoder(wiring, len(motors.line.channels), 2.0 * settings.control_period)
        self.last_command: MITCommand | None = None
        self.refused = 0
        """Commands that were not sent as they were: not enabled, or not finite."""
        self.faults: Mapping[str, tuple[str, ...]] = {}
        """By joint, what the latest statuses say of its motor; empty before enabling, and where a guardian drives."""
        zeros = np.zeros(wiring.count)
        self._damped = MITCommand(zeros, zeros, zeros, zeros, settings.damping)

    @property
    def is_enabled(self) -> bool:
        """Return whether the motors were enabled, and not disabled since by this program."""
        return self._watch is not None

    @property
    def jumped(self) -> frozenset[str]:
        """Joints whose position jumped."""
        names = self._settings.wiring.names
        return frozenset(names[i] for i in np.flatnonzero(self._tracker.jumped))

    def enable(self, now: float) -> None:
        """Note that the motors are enabled as of `now`, s, robot's clock."""
        self._motors.begin()
        self._watch = SafetyWatch(self._settings, self._motors, since=now)

    def disable(self) -> None:
        """Note that the motors are disabled: nothing more is sent."""
        self._watch = None

    def read(self) -> JointReadings:
        """Return the joints' latest state."""
        readings = self._motors.readings()
        self._warmest = np.fmax(self._warmest, readings.temperature)
        self._joints = self._tracker.update(readings)
        return self._joints

    @property
    def warmest(self) -> Mapping[str, float]:
        """By joint, °C, the most that was read; joints whose motors do not tell it are left out."""
        warmth = zip(self._settings.wiring.names, self._warmest.tolist(), strict=True)
        return {name: value for name, value in warmth if not math.isnan(value)}

    def statuses(self, now: float, age: FloatArray) -> tuple[SafetyStatus, ...]:
        """One status per channel, one about this program's commands if one was bad, one of a guardian that has news.

        None before enabling. `now` and `age` are those of `SafetyWatch.statuses`.
        """
        if self._watch is None:
            return ()
        told = self._guard.status()
        if told is not None and told.level is SafetyLevel.FAULT:
            self.faults = {}
            return (told,)  # whatever the motors do is its doing
        statuses = self._watch.statuses(now, age, self._tracker)
        self.faults = self._watch.faults
        if now - self._bad_command <= self._settings.rx_timeout:
            statuses = (*statuses, _BAD_COMMAND)
        return statuses if told is None else (*statuses, told)

    def write(self, command: MITCommand, now: float) -> None:
        """Hand a command, shape (n,), to every motor. One that is not finite is replaced by damping."""
        if self._watch is None:
            self.refused += 1
            return
        self._watch.beat(now)
        if not command.is_finite():
            self.refused += 1
            self._bad_command = now
            command = self._damped
        self.last_command = command
        batches = self.encoder.encode(command, self._joints, self._tracker)
        self._motors.count_commands()
        for channel, batch in zip(self._motors.line.channels, batches, strict=True):
            channel.send(batch, _LIFETIME * self._settings.control_period)
        self._guard.beat()

    def damp(self, now: float) -> None:
        """DAMPING's command, which needs no state."""
        self.write(self._damped, now)


class CommandEncoder:
    """Joint commands to frames, counting what was cut off."""

    def __init__(self, wiring: Wiring, channel_count: int, lead: float) -> None:
        """Prepare; `lead` in s, see `bounded_position`."""
        self._wiring = wiring
        self._lead = lead
        self._channel_count = channel_count
        joints = {family: np.array(wiring.of_family(family), dtype=int) for family in DRIVERS}
        self._encoders = tuple(
            (own, DRIVERS[family].encoder(wiring.select(own.tolist()))) for family, own in joints.items() if len(own)
        )
        families = [FAMILIES[model.family] for model in wiring.model]
        self._stiffness_doubt = np.array([family.stiffness_doubt for family in families])
        self._damping_doubt = np.array([family.damping_doubt for family in families])
        self._gains_apart = np.array([family.gains_apart for family in families])
        self._saturated: npt.NDArray[np.int64] = np.zeros((len(COMMAND_FIELDS), wiring.count), dtype=np.int64)
        self._bounded: npt.NDArray[np.int64] = np.zeros(wiring.count, dtype=np.int64)

    def encode(
        self, command: MITCommand, state: JointReadings, tracker: JointTracker
    ) -> tuple[tuple[tuple[tuple[int, int], Frame], ...], ...]:
        """For each channel the frames with their keys, joint and kind. The command must be finite, its shape (n,)."""
        wiring = self._wiring
        limit = wiring.effort_limit
        effort = np.clip(command.effort, -limit, limit)
        # what the motors may make of the gains, where that is in doubt
        stiffness, damping = self._stiffness_doubt * command.stiffness, self._damping_doubt * command.damping
        limited = MITCommand(command.position, command.velocity, effort, stiffness, damping)
        position = bounded_position(limited, state.position, state.velocity, limit, self._lead)
        self._saturated[2] += effort != command.effort
        self._bounded += position != command.position
        # Without K_p the position says nothing, unless a lost frame has left the motor its old K_p: then, stay there.
        is_free = self._gains_apart & (command.stiffness == 0.0) & np.isfinite(state.position)
        position = np.where(is_free, state.position, position)
        values = np.array(
            [
                tracker.to_motor(position),
                wiring.direction * command.velocity,
                wiring.direction * effort,
                command.stiffness,
                command.damping,
            ]
        )
        batches: list[list[tuple[tuple[int, int], Frame]]] = [[] for _ in range(self._channel_count)]
        for joints, encoder in self._encoders:
            encoded = encoder.encode(values[:, joints])
            self._saturated[:, joints] += encoded.saturated
            for motor, kind, frame in encoded.frames:
                joint = int(joints[motor])
                batches[wiring.channel[joint]].append(((joint, kind), frame))
        return tuple(map(tuple, batches))

    @property
    def saturations(self) -> Mapping[str, Mapping[str, int]]:
        """By joint and field of the command: how often a value was cut off. Joints without any are left out."""
        return {
            name: {field: int(n) for field, n in zip(COMMAND_FIELDS, self._saturated[:, i], strict=True) if n}
            for i, name in enumerate(self._wiring.names)
            if self._saturated[:, i].any()
        }

    @property
    def bounded(self) -> Mapping[str, int]:
        """By joint: how often the position was moved so that the MIT law stays within the effort limit."""
        return {name: int(n) for name, n in zip(self._wiring.names, self._bounded, strict=True) if n}


_LONGEST = 3.0
"""s that damping may take, as at the end of a session."""
_PERIOD = 0.01
"""s between its commands."""
_SLOW = 0.05
"""rad/s below which a joint that is damped already needs no more of it."""


def is_limp(command: MITCommand) -> bool:
    """Return whether a command exerts no torque, whatever the joints do."""
    return not (command.stiffness.any() or command.damping.any() or command.effort.any())


def is_damped(command: MITCommand, state: MITState, stale: float) -> bool:
    """Return whether the joints are known to rest under a command that only damps them.

    A joint that has been silent for more than `stale` s may have been at rest then, and fall now.
    """
    passive = not (command.stiffness.any() or command.effort.any())
    slow = bool((np.abs(state.joint_velocity) < _SLOW).all())
    return passive and slow and bool((state.joint_age <= stale).all())


def damp_until_rest(read: Callable[[], MITState], damp: Callable[[], None], stale: float) -> None:
    """Damp until the joints are known to rest, for 3 s at most, and for all of that where one is silent."""
    rest = RestDetector(_PERIOD)
    deadline = time.monotonic() + _LONGEST
    while time.monotonic() < deadline:
        damp()
        state = read()
        if (state.joint_age > stale).any():
            rest = RestDetector(_PERIOD)
        elif rest.update(state):
            return
        time.sleep(_PERIOD)


def unconfirmed(settings: AdapterSettings, motors: RobotMotors | None, joints: Sequence[int]) -> str:
    """Return what to tell whoever stands next to motors that may still be enabled."""
    wiring = settings.wiring
    states = ["no status" if motors is None else motors.state_text(i) for i in joints]
    names = ", ".join(f"{wiring.names[i]} ({state})" for i, state in zip(joints, states, strict=True))
    if all(FAMILIES[wiring.model[i].family].has_timeout for i in joints):
        end = f"Without commands their CAN timeout stops them after {1000.0 * settings.can_timeout:g} ms"
    else:
        end = "Not all of them stop by themselves without commands"
    return f"not confirmed to be disabled: {names}. {end}; switch the power off before touching the robot"
