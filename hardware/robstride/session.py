"""Session with a robot's Robstride motors: prepare, enable, watch and command them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from humanoid_sim.hardware.bus.frame import bus_load
from humanoid_sim.hardware.bus.open_channels import OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motors import STOPPED, Finding, MotorFigures, MotorGroup, Readings, SessionTerms
from humanoid_sim.hardware.robstride.enabling import (
    enable_motors,
    examine,
    make_ready,
    mode_text,
    set_reports,
    stop_motors,
)
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion, firmware_of
from humanoid_sim.hardware.robstride.messages import FaultBit, MotorMode, Status, StatusFault, WarningBit, flag_names
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, report_interval
from humanoid_sim.hardware.robstride.requests import RobstrideLink
from humanoid_sim.messages import SafetyFlag

_REPORT_WAIT = 0.3
"""s at most in which the first active reports must come."""
_SCAN_TIME = 1
"""`EPScan_time` of the shortest report interval."""
_FULL_BUS = 0.6
"""Share of a bus up to which active reports are worth their frames."""
_LAST_ANSWERS = 0.1
"""s at most in which the last commands are answered."""
_HOT = "motor_overtemperature"
"""The name of that bit in status and fault report alike."""
_WARNS = "motor_overtemperature_warning"
"""The name of that bit in a fault report."""


class RobstrideSession(RobstrideLink):
    """See `MotorLink`."""

    knows_positions = True

    def __init__(self, line: OpenChannels, motors: MotorGroup, terms: SessionTerms) -> None:
        """Send nothing yet; with no motors of the family it only tells what strangers are heard."""
        super().__init__(line, motors, terms.host_id)
        self._terms = terms
        self._joints = range(motors.count)
        self._versions: Mapping[int, FirmwareVersion] = {}
        self._reporting: tuple[int, ...] = ()
        self._heat = [("", "") for _ in self._joints]
        self.uids: Mapping[str, bytes] = {}
        """Unique ids by joint."""

    # --- activation

    def examine(self, checks: CheckList) -> None:
        """See `MotorLink`."""
        names, known = self.motors.names, self._terms.known_uids
        known_uids = {i: known[names[i]] for i in self._joints if names[i] in known}
        uids, self._versions = examine(self, self._joints, checks, known_uids=known_uids, takes_over=True)
        self.uids = {names[i]: uid for i, uid in uids.items()}

    def make_ready(self, checks: CheckList) -> None:
        """See `MotorLink`."""
        make_ready(self, self._joints, self._terms.can_timeout, checks, takes_over=True)
        found = self.read(dict.fromkeys(self._joints, PARAMETERS["VBUS"]))
        for channel, source in enumerate(self.sources):
            here = self.motors.on_channel(channel)
            volts = [v for i in here if isinstance(v := found[i], float)]
            if volts:
                least, most = f"{min(volts):.1f}", f"{max(volts):.1f}"
                checks.passed(source, f"supply {least if least == most else f'{least} to {most}'} V at its motors")
            elif here:
                checks.warn(source, "no motor tells its supply voltage")

    def counted(self) -> Mapping[int, float | None]:
        """See `MotorLink`: `mechPos`."""
        found = self.read(dict.fromkeys(self._joints, PARAMETERS["mechPos"]))
        return {i: own if isinstance(own, float) else None for i, own in found.items()}

    def start(self, checks: CheckList) -> None:
        """Switch active reports on where they help: a motor otherwise answers commands only, a period too early."""
        motors, period = self.motors, self._terms.control_period
        able = [i for i in self._joints if firmware_of(motors.model[i], self._versions[i]).has_active_reports]
        wanted: list[int] = []
        for channel, source in enumerate(self.sources):
            here = motors.on_channel(channel)
            interval = report_interval(_SCAN_TIME)
            load = bus_load(2.0 * self._terms.period_frames[channel] / period + len(here) / interval)
            if interval >= period:
                checks.passed(source, "no active reports: commands are answered as often")
            elif load > _FULL_BUS:
                checks.passed(source, f"no active reports: they would load the bus to {100.0 * load:.0f} %")
            else:
                wanted += [i for i in here if i in able]
        self.write(PARAMETERS["EPScan_time"], dict.fromkeys(wanted, float(_SCAN_TIME)))
        slots = self.table.slots
        before = [slot.reports + slot.statuses for slot in slots]

        def silent() -> list[int]:
            """Motors that sent no more than one status: that may have answered the request."""
            return [i for i in wanted if slots[i].reports + slots[i].statuses <= before[i] + 1]

        set_reports(self, wanted, is_on=True)
        self.line.wait(lambda: not silent(), _REPORT_WAIT)
        for i in silent():
            checks.warn(motors.names[i], "sends no active reports: its state is a control period old")
        self._reporting = tuple(wanted)

    def enable(self, checks: CheckList) -> None:
        """See `MotorLink`."""
        enable_motors(self, self._joints, self._terms.can_timeout, checks)

    def stop(self, motors: Iterable[int]) -> tuple[int, ...]:
        """See `MotorLink`."""
        return stop_motors(self, motors)

    def state_text(self, motor: int) -> str:
        """See `MotorLink`."""
        return mode_text(self.table.slots[motor])

    # --- control

    def begin(self) -> None:
        """See `MotorLink`."""
        self.table.inbox = None

    def readings(self) -> Readings:
        """See `MotorLink`."""
        return self.table.readings()

    def findings(self, motor: int, recent: float) -> Iterator[Finding]:
        """See `MotorLink`."""
        slot, name = self.table.slots[motor], self.motors.names[motor]
        sample, alarm, report = slot.sample, slot.alarm, slot.report
        found: list[Finding] = []
        if sample is not None and alarm is not None and (alarm is sample or alarm.time >= recent):
            found += _alarm(name, alarm.status)
        if report is not None and (report.faults or report.warnings):
            found += _report(name, report.faults, report.warnings)
        yield from self._with_temperature(motor, found)
        if slot.invalid.time >= recent:
            yield SafetyFlag.INVALID_FRAME, f"sent a {slot.invalid.text}", name

    def _with_temperature(self, motor: int, found: list[Finding]) -> list[Finding]:
        """Return the findings; those of a hot motor in words, with the temperature at which each was first seen.

        That it goes on rising is no news, and a message that changed in every tick would be published in every tick.
        """
        words = {what for _, what, _ in found}
        kind = next((kind for kind in (_HOT, _WARNS) if kind in words), "")
        if not kind:
            self._heat[motor] = ("", "")
            return found
        if self._heat[motor][0] != kind:
            model, sample = self.motors.model[motor], self.table.slots[motor].sample
            now = "" if sample is None else f": {sample.status.temperature:.0f} °C"
            adverb = "" if kind == _HOT else "nearly "
            self._heat[motor] = (kind, f"is {adverb}too hot{now} (limit {model.fault_temperature:g} °C)")
        told = self._heat[motor][1]
        return [(flag, told if what in (_HOT, _WARNS) else what, name) for flag, what, name in found]

    def count_commands(self) -> None:
        """See `MotorLink`."""
        self.table.count_commands()

    def figures(self, motor: int) -> MotorFigures:
        """See `MotorLink`."""
        slot = self.table.slots[motor]
        return MotorFigures(slot.commanded, slot.acknowledged, slot.reports, slot.invalid_frames)

    def finish(self) -> None:
        """See `MotorLink`."""
        self.line.wait(lambda: self.unanswered <= 0, _LAST_ANSWERS)
        self.table.counts_answers = False
        self.line.forget_queues()
        set_reports(self, self._reporting, is_on=False)


def _alarm(name: str, status: Status) -> Iterator[Finding]:
    yield from _faults(name, status.faults)
    if status.mode is not MotorMode.RUN:
        is_reset = status.mode is MotorMode.RESET
        yield SafetyFlag.MOTOR_FAULT, STOPPED if is_reset else f"left run mode (mode {status.mode.name.lower()})", name


def _report(name: str, faults: FaultBit, warnings: WarningBit) -> Iterator[Finding]:
    yield from _faults(name, faults)
    for warning in flag_names(warnings):
        yield SafetyFlag.TEMPERATURE_LIMIT if warning == _WARNS else SafetyFlag.MOTOR_FAULT, warning, name


def _faults(name: str, faults: StatusFault | FaultBit) -> Iterator[Finding]:
    for fault in flag_names(faults):
        yield SafetyFlag.MOTOR_FAULT, fault, name
        if fault == _HOT:
            yield SafetyFlag.TEMPERATURE_LIMIT, fault, name
