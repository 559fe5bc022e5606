"""The one way to motors that execute commands, and back: make ready, enable, stop."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence

from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.messages import FaultBit, MotorMode, flag_names
from humanoid_sim.hardware.robstride.parameters import (
    PARAMETERS,
    CanTimeout,
    RunMode,
    fault_word,
    pack_value,
    unpack_value,
)

CAN_TIMEOUT = 0.1  # s without a command after which a motor stops by itself, unless another time is wanted
_TIMEOUT = PARAMETERS["canTimeout"]


def make_ready(link: RobstrideLink, can_timeout: float, checks: CheckList) -> None:
    """Stop the motors, clear their faults, and configure them; leaves them stopped.

    Without a CAN timeout a motor executes its last command for ever when the host dies, so one that does not confirm it
    is not enabled; nor is one that would take another kind of command, or more torque than it was given. `can_timeout`
    in s.
    """
    motors, everyone = link.motors, range(link.motors.count)
    _stop_and_check(link, checks)
    _write(link, "run_mode", dict.fromkeys(everyone, float(RunMode.OPERATION)), checks)
    ticks = float(CanTimeout.to_ticks(can_timeout))
    found = _write(link, "canTimeout", dict.fromkeys(everyone, ticks), checks, may_hide=True)
    for i in everyone:
        link.slots[i].hides_timeout = found.get(i) is None  # some manuals have it as one that cannot be read
        if found.get(i) == ticks:
            checks.passed(motors.names[i], f"stops {1000.0 * can_timeout:g} ms after the last command")
    # Never a limit above the peak of the motor's data sheet; 0 leaves the firmware's own.
    torque = {i: min(limit, motors.model[i].peak_torque) for i, limit in enumerate(motors.torque_limit) if limit > 0.0}
    _write(link, "limit_torque", torque, checks)
    # Documented for the velocity and position modes only, so that it need not be readable.
    current = {i: min(top, motors.model[i].peak_current) for i, top in enumerate(motors.current_limit) if top > 0.0}
    _write(link, "limit_cur", current, checks, may_hide=True)


def _write(
    link: RobstrideLink, name: str, values: Mapping[int, float], checks: CheckList, *, may_hide: bool = False
) -> dict[int, float | None]:
    """Write a parameter and return what is read back; another value is a problem, but for a limit that is lower."""
    parameter = PARAMETERS[name]
    found = link.write(parameter, values)
    for i, wanted in values.items():
        motor, value = link.motors.names[i], found.get(i)
        if value is None and may_hide:
            checks.warn(motor, f"{name} cannot be read")
        elif value is None or not (parameter.is_same(value, wanted) or (parameter.type.is_float and value < wanted)):
            checks.problem(motor, f"{name} reads {_text(value)} after {wanted:g} was written")
        elif parameter.type.is_float:
            checks.passed(motor, f"{name} {value:g} {parameter.unit}")
    return found


def _text(value: float | None) -> str:
    return "nothing" if value is None else f"{value:g}"


def stop_motors(link: RobstrideLink, joints: Iterable[int], *, clear_faults: bool = False) -> tuple[int, ...]:
    """Stop these motors, and clear their faults on request; returns those that did not confirm it."""
    motor_id = link.motors.motor_id
    commands = {i: [messages.Stop(motor_id[i], clear_faults)] for i in joints}

    def is_done(status: messages.Status) -> bool:
        return status.mode is MotorMode.RESET and not (clear_faults and status.faults)

    confirmed = link.until_status(commands, is_done)
    return tuple(i for i in commands if i not in confirmed)


def _stop_and_check(link: RobstrideLink, checks: CheckList) -> None:
    """Stop the motors and clear their faults; what is left of them is a problem.

    The fault words are read as well: they show what no status does, overvoltage.
    """
    names, slots, everyone = link.motors.names, link.slots, range(link.motors.count)
    silent = stop_motors(link, everyone)
    words = _fault_words(link, everyone)

    def faults(i: int) -> str:
        sample = slots[i].sample
        status = () if sample is None else flag_names(sample.status.faults)
        return ", ".join(dict.fromkeys([*status, *flag_names(FaultBit(words.get(i, 0)))]))

    faulty = [i for i in everyone if faults(i)]
    for i in faulty:
        checks.warn(names[i], f"had faults, cleared: {faults(i)}")
    stop_motors(link, [i for i in faulty if i not in silent], clear_faults=True)
    words.update(_fault_words(link, faulty))
    for i in everyone:
        if i in silent:
            checks.problem(names[i], f"does not confirm that it is stopped ({slots[i].mode_text})")
        elif left := faults(i):
            checks.problem(names[i], f"faults do not clear: {left}")
        if i not in words:
            checks.warn(names[i], "its fault word cannot be read: overvoltage would not be seen here")


def _fault_words(link: RobstrideLink, joints: Iterable[int]) -> dict[int, int]:
    """Return the fault words of these motors; those that cannot be read are left out."""
    found = link.read({i: fault_word(link.motors.model[i].name) for i in joints})
    return {i: int(word) for i, word in found.items() if word is not None}


_LONGEST = 1.0  # s in which every motor must run and have confirmed its CAN timeout
_PERIOD = 0.02  # s between two rounds of commands meanwhile, well within the CAN timeout
_POLL = 0.001  # s


def enable_motors(  # noqa: PLR0912 - one loop over the motors' answers
    link: RobstrideLink, can_timeout: float, checks: CheckList
) -> None:
    """Enable the motors, without torque; one that does not run afterwards, or has booted meanwhile, is a problem.

    A command without gains or effort goes before and after each enable: some firmware keeps its last command, and
    nobody knows what the last program that talked to this motor wanted of it. The same command goes on to those that
    run already, or their CAN timeout would stop them meanwhile. The timeout is read back once more from each motor that
    runs: one whose supply failed for a moment since it was configured has lost it, and would execute its last command
    for ever. A motor whose timeout cannot be read must show it first, see `_try_timeouts`, and gets it once more right
    before it is enabled. All were made ready with this timeout, s.
    """
    motors, slots, joints = link.motors, link.slots, range(link.motors.count)
    _try_timeouts(link, [i for i in joints if slots[i].hides_timeout], can_timeout, checks)
    if checks.problems:
        return
    before = {i: slots[i].sample for i in joints}
    ticks = CanTimeout.to_ticks(can_timeout)
    payload = pack_value(_TIMEOUT.type, ticks)
    confirmed: dict[int, float] = {}
    link.take_answers()
    deadline = time.monotonic() + _LONGEST
    while True:
        running = [i for i in joints if slots[i].sample is not before[i] and slots[i].runs]
        confirmed = {i: found for i, found in confirmed.items() if i in running}
        confirmed.update((i, ticks) for i in running if slots[i].hides_timeout)
        if len(confirmed) == len(joints) or time.monotonic() > deadline:
            break
        for i in joints:  # one motor after the other: no other's frames between enable and limp
            motor_id, limp = motors.motor_id[i], _limp_command(link, i)
            commands: list[messages.Command] = [limp]
            if i not in running and slots[i].hides_timeout:
                commands.append(messages.WriteParameter(motor_id, _TIMEOUT.index, payload))
            if i not in running:
                commands += [messages.Enable(motor_id), limp]
            elif i not in confirmed:
                commands.append(messages.ReadParameter(motor_id, _TIMEOUT.index))
            link.send({i: commands})
        end = time.monotonic() + _PERIOD
        while time.monotonic() < end and len(confirmed) < len(joints):
            for joint, reply in link.take_answers():
                if isinstance(reply, messages.ParameterReply) and reply.index == _TIMEOUT.index:
                    confirmed[joint] = float(unpack_value(_TIMEOUT.type, reply.payload)) if reply.is_success else -1.0
            time.sleep(_POLL)
    for i in joints:
        if i not in running:
            checks.problem(motors.names[i], f"was not enabled ({slots[i].mode_text})")
        elif confirmed.get(i) != ticks:
            text = f"its canTimeout reads {_text(confirmed.get(i))} after it was enabled: has it booted meanwhile?"
            checks.problem(motors.names[i], text)


_TRIALS = 4
_SILENCE = 1.5  # CAN timeouts without a command after which a motor must have stopped
_TOO_LONG = 2.5  # CAN timeouts after which that shows nothing: this program itself was held up


def _try_timeouts(link: RobstrideLink, joints: Sequence[int], can_timeout: float, checks: CheckList) -> None:
    """Run these motors without torque, be silent for longer than the timeout, and reject those that run on.

    Nothing at all is sent to them meanwhile: no document says which frames restart the timeout.
    """
    untried = list(joints)
    for _ in range(_TRIALS):
        if not untried:
            return
        begin = time.monotonic()
        limp = {i: _limp_command(link, i) for i in untried}
        enable: dict[int, Sequence[messages.Command]] = {
            i: [limp[i], messages.Enable(limp[i].motor_id), limp[i]] for i in untried
        }
        running = link.until_status(enable, lambda status: status.mode is MotorMode.RUN and not status.faults)
        time.sleep(_SILENCE * can_timeout)
        found = link.until_status({i: [limp[i]] for i in running}, lambda _: True)
        if time.monotonic() - begin > _TOO_LONG * can_timeout:
            continue
        for i, status in found.items():
            if status.mode is MotorMode.RESET and not status.faults:
                untried.remove(i)
                checks.passed(link.motors.names[i], "canTimeout cannot be read; it was seen to stop without commands")
    stop_motors(link, untried)
    for i in untried:
        text = f"canTimeout cannot be read, and it was not seen to stop {1000.0 * _SILENCE * can_timeout:g} ms after"
        checks.problem(link.motors.names[i], f"{text} the last command")


def _limp_command(link: RobstrideLink, joint: int) -> messages.OperationControl:
    """Return a command without gains or effort, at the motor's position if that is known."""
    sample = link.slots[joint].sample
    position = 0.0 if sample is None else sample.status.position
    return messages.OperationControl(link.motors.motor_id[joint], position, 0.0, 0.0, 0.0, 0.0)
