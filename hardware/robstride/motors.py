"""A robot's Robstride motors: identify, configure, enable, watch, command and stop them."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence

from humanoid_sim.hardware.can_bus import Frame, OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motor_link import Finding, LinkTerms, Motor, MotorLink
from humanoid_sim.hardware.robstride import firmware, parameters, protocol
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.robstride.protocol import FrameType, MotorMode, flag_names
from humanoid_sim.messages import SafetyFlag
from humanoid_sim.mit import FloatArray

_LISTENING = 0.05  # s of silence in which another host would be noticed, before anything is sent
_QUIET = 0.1  # s without an answer that end the scan; motors answer within a few milliseconds
_LONGEST = 1.0  # s in which every motor must run and have confirmed its CAN timeout
_PERIOD = 0.02  # s between two rounds of commands meanwhile, well within the CAN timeout
_POLL = 0.001  # s
_SILENCE = 1.5  # CAN timeouts without a command after which a motor must have stopped
_TOO_LONG = 2.5  # CAN timeouts after which that shows nothing: this program itself was held up
_SCAN_TIME = 1  # `EPScan_time` of the shortest report interval
_LIFETIME = 2.0  # control periods after which a command that has not left never leaves
_TIMEOUT = PARAMETERS["canTimeout"]
_FLAGS = {  # of faults that are more, or less, than a motor fault
    "motor_overtemperature": SafetyFlag.MOTOR_FAULT | SafetyFlag.TEMPERATURE_LIMIT,
    "motor_overtemperature_warning": SafetyFlag.TEMPERATURE_LIMIT,
}


class RobstrideMotors(RobstrideLink, MotorLink):
    """See `MotorLink`. A motor is stopped by its own CAN timeout, which is set and read back before it is enabled."""

    def __init__(self, line: OpenChannels, motors: Sequence[Motor], terms: LinkTerms) -> None:
        super().__init__(line, motors)
        self._terms = terms
        self._all = range(len(motors))
        self._timeout_ticks = float(round(terms.can_timeout / parameters.CAN_TIMEOUT_TICK))
        self._hidden: list[int] = []  # motors whose CAN timeout cannot be read, and is tried out
        self._versions: Mapping[int, firmware.FirmwareVersion] = {}
        self._reporting: list[int] = []

    # --- identify

    def examine(self, checks: CheckList) -> None:
        time.sleep(_LISTENING)
        self.line.check(checks)
        checks.refuse()
        uids = self._identify(checks)
        self._versions = self.read_versions(uids)
        for i in sorted(uids):
            name, channel, motor_id, model, *_ = self.motors[i]
            version = self._versions.get(i)
            if version is None:
                checks.problem(name, "does not report its firmware's version, by which its scales are known")
                continue
            if problem := firmware.firmware_problem(model, version):
                checks.problem(name, problem)
                continue
            where, text = f"motor {motor_id} on {self.sources[channel]}", firmware.version_text(version)
            checks.passed(name, f"{where}, {model.name}, firmware {text}, uid {uids[i].hex()}")
            if not firmware.is_documented(model, version) and text not in self._terms.accepted_firmware:
                known = f"--accept-firmware {text} if you know its ranges and gains"
                checks.question(name, f"firmware {text}: no document mentions it: {known}")

    def _identify(self, checks: CheckList) -> dict[int, bytes]:
        """Return the unique ids of the motors of which there is one with their id, on their channel."""
        answers: defaultdict[int, set[tuple[int, bytes]]] = defaultdict(set)  # channel and unique id, by motor id
        for channel, reply in self.scan(sorted({motor.motor_id for motor in self.motors}), _QUIET):
            answers[reply.motor_id].add((channel, reply.uid))
        missing = [i for i, one in enumerate(self.motors) if one.channel not in dict(answers[one.motor_id])]
        for i, uid in self.read_uids(missing).items():  # an answer may have been lost
            answers[self.motors[i].motor_id].add((self.motors[i].channel, uid))
        uids = {}
        for i, (name, channel, number, *_) in enumerate(self.motors):
            source = self.sources[channel]
            found = [f"{uid.hex()} on {self.sources[other]}" for other, uid in sorted(answers[number])]
            if [other for other, _ in answers[number]] != [channel]:
                reasons = [*found, *self.line.channels[channel].troubles(), self.slots[i].invalid.text]
                silent = "none answers: supply, cable or id? `hardware discover` asks every id"
                answer = "; ".join(filter(None, reasons)) or silent
                checks.problem(name, f"expected one motor {number} on {source}; {answer}")
                continue
            ((_, uids[i]),) = answers[number]
            if self._terms.uids.setdefault(name, uids[i]) != uids[i]:
                checks.problem(name, f"its motor was exchanged (id {number} on {source}): calibrate it")
        return uids

    # --- stop, configure, read back

    def make_ready(self, checks: CheckList) -> None:
        """Refuse a motor that does not confirm its CAN timeout, mode and limits.

        Without the timeout it would execute its last command for ever when the host dies.
        """
        self._stop_and_clear(checks)
        self._configure("run_mode", dict.fromkeys(self._all, parameters.OPERATION_MODE), checks)
        found = self._configure("canTimeout", dict.fromkeys(self._all, self._timeout_ticks), checks, may_hide=True)
        # Some manuals have it as one that is written only.
        self._hidden = [i for i in self._all if math.isnan(found.get(i, math.nan))]
        # Never a limit above the peak of the motor's data sheet; 0 leaves the firmware's own.
        limits = [(i, each, each.model) for i, each in enumerate(self.motors)]
        torque = {i: min(each.torque_limit, model.peak_torque) for i, each, model in limits if each.torque_limit}
        self._configure("limit_torque", torque, checks)
        # Documented for the velocity and position modes only, so that it need not be readable.
        current = {i: min(each.current_limit, model.peak_current) for i, each, model in limits if each.current_limit}
        self._configure("limit_cur", current, checks, may_hide=True)
        counted = self.read(PARAMETERS["mechPos"], self._all)
        for i, (motor, slot) in enumerate(zip(self.motors, self.slots, strict=True)):
            own, sample = counted.get(i, math.nan), slot.sample  # the reported position wraps, `mechPos` does not
            if math.isnan(own):
                text = "mechPos cannot be read: whether it turned beyond ±4π since power-on is not known"
                checks.warn(motor.name, text)
            elif sample is not None and not abs(own - sample.status.position) < motor.model.position:
                checks.problem(motor.name, "turned beyond ±4π since power-on: switch it off and on")

    def _stop_and_clear(self, checks: CheckList) -> None:
        """Stop the motors and clear their faults; what is left of them is a problem."""
        silent = self.stop_motors(self._all)
        before = self._faults()
        self.stop_motors([i for i in self._all if before[i] and i not in silent], clear_faults=True)
        left = self._faults()
        for i, motor in enumerate(self.motors):
            if i in silent:
                checks.problem(motor.name, f"does not confirm that it is stopped ({self.slots[i].mode_text})")
            elif left[i]:
                checks.problem(motor.name, f"faults do not clear: {left[i]}")
            elif before[i]:
                checks.warn(motor.name, f"had faults, cleared: {before[i]}")

    def _faults(self) -> list[str]:
        """Return each motor's faults: of its status, and of its fault word, which alone shows overvoltage."""
        words: dict[int, float] = {}
        for name in {motor.model.name for motor in self.motors}:
            words |= self.read(parameters.fault_word(name), [i for i in self._all if self.motors[i].model.name == name])
        faults = []
        for i, slot in enumerate(self.slots):
            word = words.get(i, math.nan)
            names = [] if math.isnan(word) else [*flag_names(protocol.FaultBit(int(word)))]
            if slot.sample is not None:
                names += flag_names(slot.sample.status.faults)
            faults.append(", ".join(dict.fromkeys(names)))
        return faults

    def _configure(
        self, name: str, values: Mapping[int, float], checks: CheckList, *, may_hide: bool = False
    ) -> dict[int, float]:
        """Write a parameter and return what is read back; another value is a problem, but for a limit that is lower."""
        parameter = PARAMETERS[name]
        found = self.write(parameter, values)
        for i, wanted in values.items():
            value = found.get(i, math.nan)
            if math.isnan(value) and may_hide:
                checks.warn(self.motors[i].name, f"{name} cannot be read")
            elif not (parameter.is_same(value, wanted) or (parameter.is_float and value < wanted)):
                checks.problem(self.motors[i].name, f"{name} reads {value:g} after {wanted:g} was written")
        return found

    # --- enable

    def enable(self, checks: CheckList) -> None:
        """Send a command without gains or effort before and after each enable: some firmware keeps its last command.

        The same command goes on to those that run already, or their CAN timeout would stop them meanwhile. The timeout
        is read back once more from each motor that runs: one whose supply failed for a moment has lost it. A motor
        whose timeout cannot be read must show it first, and gets it once more right before it is enabled.
        """
        self._start_reports()
        self._try_timeouts(checks)
        if checks.problems:
            return
        before = [slot.sample for slot in self.slots]
        confirmed: dict[int, float] = {}
        self.take_values(_TIMEOUT)  # answers to earlier questions
        deadline = time.monotonic() + _LONGEST
        while True:
            running = [i for i, slot in enumerate(self.slots) if slot.sample is not before[i] and slot.runs]
            hidden = dict.fromkeys(self._hidden, self._timeout_ticks)
            confirmed = {i: ticks for i, ticks in (confirmed | hidden).items() if i in running}
            if len(confirmed) == len(self._all) or time.monotonic() > deadline:
                break
            self.send({i: self._enabling_frames(i, i in running, i in confirmed) for i in self._all})
            end = time.monotonic() + _PERIOD
            while time.monotonic() < end and len(confirmed) < len(self._all):
                confirmed |= self.take_values(_TIMEOUT)
                time.sleep(_POLL)
        for i, motor in enumerate(self.motors):
            if i not in running:
                checks.problem(motor.name, f"was not enabled ({self.slots[i].mode_text})")
            elif confirmed.get(i) != self._timeout_ticks:
                checks.problem(
                    motor.name, f"its canTimeout reads {confirmed.get(i)} after it was enabled: has it booted?"
                )

    def _enabling_frames(self, motor: int, runs: bool, is_confirmed: bool) -> list[Frame]:
        limp = self._limp(motor)
        if runs:
            question = self.frame(motor, FrameType.READ_PARAMETER, protocol.parameter_data(_TIMEOUT.index))
            return [limp] if is_confirmed else [limp, question]
        again = [self.write_frame(motor, _TIMEOUT, self._timeout_ticks)] if motor in self._hidden else []
        return [*again, limp, self.frame(motor, FrameType.ENABLE), limp]

    def _limp(self, motor: int) -> Frame:
        """Return a command without gains or effort, at the motor's position if that is known."""
        sample = self.slots[motor].sample
        position = 0.0 if sample is None else sample.status.position
        command = protocol.OperationControl(position, 0.0, 0.0, 0.0, 0.0)
        return protocol.encode_operation(self.motors[motor].motor_id, command, self.motors[motor].model)

    def _try_timeouts(self, checks: CheckList) -> None:
        """Run motors that hide their timeout without torque, be silent for longer, and reject those that run on.

        Nothing at all is sent to them meanwhile: no document says which frames restart the timeout.
        """
        begin, can_timeout = time.monotonic(), self._terms.can_timeout
        frames = {i: self._enabling_frames(i, False, False) for i in self._hidden}
        running = self.until_status(frames, lambda status: status.mode is MotorMode.RUN and not status.faults)
        time.sleep(_SILENCE * can_timeout if running else 0.0)
        found = self.until_status({i: [self._limp(i)] for i in running}, lambda _: True)
        in_time = time.monotonic() - begin <= _TOO_LONG * can_timeout
        for i in self._hidden:
            if not (in_time and i in found and found[i].mode is MotorMode.RESET and not found[i].faults):
                text = f"it was not seen to stop {1000.0 * _SILENCE * can_timeout:g} ms after the last command"
                checks.problem(self.motors[i].name, f"its canTimeout cannot be read, and {text}")

    def _start_reports(self) -> None:
        """Switch active reports on where they help: a motor otherwise answers commands only, a period too early."""
        if parameters.report_interval(_SCAN_TIME) < self._terms.control_period:
            versions = self._versions.items()
            self._reporting = [
                i for i, version in versions if firmware.has_active_reports(self.motors[i].model, version)
            ]
        self.write(PARAMETERS["EPScan_time"], dict.fromkeys(self._reporting, _SCAN_TIME))
        self.send({i: [self.frame(i, FrameType.ACTIVE_REPORT, protocol.REPORTS_ON)] for i in self._reporting})

    # --- control

    def findings(self, since: float) -> Iterator[Finding]:
        for motor, slot in zip(self.motors, self.slots, strict=True):
            names: list[str] = []
            if slot.sample is not None:
                status = slot.sample.status
                names += flag_names(status.faults)
                if status.mode is not MotorMode.RUN:
                    yield Finding(motor, SafetyFlag.MOTOR_FAULT, f"left run mode (mode {status.mode.name.lower()})")
            if slot.report is not None:
                names += [*flag_names(slot.report.faults), *flag_names(slot.report.warnings)]
            for name in names:
                yield Finding(motor, _FLAGS.get(name, SafetyFlag.MOTOR_FAULT), name)
            if slot.invalid.time >= since:
                yield Finding(motor, SafetyFlag.INVALID_FRAME, slot.invalid.text)

    def command(self, values: FloatArray) -> None:
        batches: list[list[tuple[Hashable, Frame]]] = [[] for _ in self.sources]
        for motor, row in zip(self.motors, values.T.tolist(), strict=True):
            frame = protocol.encode_operation(motor.motor_id, protocol.OperationControl(*row), motor.model)
            batches[motor.channel].append((motor.name, frame))
        for channel, batch in zip(self.line.channels, batches, strict=True):
            channel.send(batch, _LIFETIME * self._terms.control_period)

    # --- the end

    def stop(self, motors: Sequence[int]) -> dict[int, str]:
        reporting = [i for i in self._reporting if i in motors]
        self.send({i: [self.frame(i, FrameType.ACTIVE_REPORT, protocol.REPORTS_OFF)] for i in reporting})
        return {i: self.slots[i].mode_text for i in self.stop_motors(motors)}
