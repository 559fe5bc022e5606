"""A robot's Robstride motors: prepare, enable, watch and command them."""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterable, Iterator, Mapping

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.bus.open_channels import OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motor_link import Finding, LinkTerms, MotorGroup, MotorLink
from humanoid_sim.hardware.robstride.codec import encode_command
from humanoid_sim.hardware.robstride.enabling import enable_motors, make_ready, stop_motors
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion, has_active_reports
from humanoid_sim.hardware.robstride.identification import identify
from humanoid_sim.hardware.robstride.link import MotorSlot, RobstrideLink
from humanoid_sim.hardware.robstride.messages import MotorMode, OperationControl, SetActiveReport, flag_names
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, report_interval
from humanoid_sim.messages import SafetyFlag, SafetyStatus
from humanoid_sim.mit import FloatArray

_LISTENING = 0.05  # s of silence in which another host would be noticed, before anything is sent
_POLL = 0.001  # s
_REPORT_WAIT = 0.3  # s at most in which the first active reports must come
_SCAN_TIME = 1  # `EPScan_time` of the shortest report interval
_FRAME_TIME = 145e-6  # s that a frame of 8 bytes takes at 1 Mbit/s: 131 bits without stuff bits, 160 with the most
_FULL_BUS = 0.6  # share of a bus up to which active reports are worth their frames
_LIFETIME = 2.0  # control periods after which a command that has not left never leaves
_FLAGS = {  # of faults that are more, or less, than a motor fault
    "motor_overtemperature": SafetyFlag.MOTOR_FAULT | SafetyFlag.TEMPERATURE_LIMIT,
    "motor_overtemperature_warning": SafetyFlag.TEMPERATURE_LIMIT,
}


class RobstrideMotors(RobstrideLink, MotorLink):
    """See `MotorLink`."""

    knows_positions = True

    def __init__(self, line: OpenChannels, motors: MotorGroup, terms: LinkTerms) -> None:
        """Send nothing yet."""
        super().__init__(line, motors)
        self._terms = terms
        self._all = range(motors.count)
        self._versions: Mapping[int, FirmwareVersion] = {}
        self._reporting: list[int] = []
        self.uids: Mapping[str, bytes] = {}

    # --- activation

    def examine(self, checks: CheckList) -> None:
        """See `MotorLink`."""
        time.sleep(_LISTENING)
        self.line.check(checks)
        checks.refuse()
        self.uids, self._versions = identify(self, checks, self._terms.known_uids)

    def make_ready(self, checks: CheckList) -> None:
        """See `MotorLink`."""
        make_ready(self, self._terms.can_timeout, checks)
        counted = self.read(dict.fromkeys(self._all, PARAMETERS["mechPos"]))
        for i, slot in enumerate(self.slots):  # the reported position wraps; `mechPos` counts turns since power-on
            name, own, sample = self.motors.names[i], counted.get(i), slot.sample
            if own is None:
                checks.warn(name, "mechPos cannot be read: whether it turned beyond ±4π since power-on is not known")
            elif sample is not None and not abs(own - sample.status.position) < self.motors.model[i].position:
                text = f"counts {own:.2f} rad and reports {sample.status.position:.2f}"
                checks.problem(name, f"{text}: it turned beyond ±4π since power-on; switch it off and on")

    def enable(self, checks: CheckList) -> None:
        """See `MotorLink`."""
        self._start_reports(checks)
        enable_motors(self, self._terms.can_timeout, checks)

    def _start_reports(self, checks: CheckList) -> None:
        """Switch active reports on where they help: a motor otherwise answers commands only, a period too early."""
        interval, period, channels = report_interval(_SCAN_TIME), self._terms.control_period, self.motors.channel
        frames = [channels.count(channel) * (2.0 / period + 1.0 / interval) for channel in channels]  # a second
        self._reporting = [
            i
            for i, version in self._versions.items()
            if interval < period
            and _FRAME_TIME * frames[i] <= _FULL_BUS
            and has_active_reports(self.motors.model[i], version)
        ]
        self.write(PARAMETERS["EPScan_time"], dict.fromkeys(self._reporting, float(_SCAN_TIME)))
        before = [slot.statuses for slot in self.slots]
        self._set_reports(self._reporting, is_on=True)

        def silent() -> list[int]:
            """Return motors that sent no more than one status: that may have answered the request."""
            return [i for i in self._reporting if self.slots[i].statuses <= before[i] + 1]

        deadline = time.monotonic() + _REPORT_WAIT
        while silent() and time.monotonic() < deadline:
            time.sleep(_POLL)
        for i in silent():
            checks.warn(self.motors.names[i], "sends no active reports: its state is a control period old")

    def _set_reports(self, motors: Iterable[int], *, is_on: bool) -> None:
        self.send({i: [SetActiveReport(self.motors.motor_id[i], is_on)] for i in motors})

    # --- control

    def findings(self, since: float) -> Iterator[Finding]:
        """See `MotorLink`."""
        for i, slot in enumerate(self.slots):
            for flag, text in _findings(slot, since):
                yield Finding(i, flag, text)

    def command(self, values: FloatArray) -> None:
        """See `MotorLink`."""
        motors = self.motors
        batches: list[list[tuple[Hashable, Frame]]] = [[] for _ in self.channels]
        for i, row in enumerate(values.T.tolist()):
            command = OperationControl(motors.motor_id[i], *row)
            batches[motors.channel[i]].append((motors.names[i], encode_command(command, motors.model[i])))
        for channel, batch in zip(self.channels, batches, strict=True):
            channel.send(batch, _LIFETIME * self._terms.control_period)

    def status(self) -> SafetyStatus | None:
        """See `MotorLink`: these motors stop by themselves."""
        return None

    # --- the end

    def stop(self, motors: Iterable[int]) -> dict[int, str]:
        """See `MotorLink`."""
        motors = list(motors)
        self._set_reports([i for i in self._reporting if i in motors], is_on=False)
        return {i: self.slots[i].mode_text for i in stop_motors(self, motors)}

    def close(self) -> None:
        """See `MotorLink`: there is nothing to release."""


def _findings(slot: MotorSlot, since: float) -> Iterator[tuple[SafetyFlag, str]]:
    names: list[str] = []
    if slot.alarm is not None and (slot.alarm is slot.sample or slot.alarm.time >= since):
        status = slot.alarm.status
        names += flag_names(status.faults)
        if status.mode is not MotorMode.RUN:
            yield SafetyFlag.MOTOR_FAULT, f"left run mode (mode {status.mode.name.lower()})"
    if slot.report is not None:
        names += [*flag_names(slot.report.faults), *flag_names(slot.report.warnings)]
    for name in names:
        yield _FLAGS.get(name, SafetyFlag.MOTOR_FAULT), name
    if slot.invalid.time >= since:
        yield SafetyFlag.INVALID_FRAME, slot.invalid.text
