"""Stop motors and clear their faults, verified by what they then report."""

from __future__ import annotations

from collections.abc import Iterable

from humanoid_sim.hardware.robot.checks import CheckList
from humanoid_sim.hardware.robot.parameter_access import ParameterAccess
from humanoid_sim.hardware.robot.requests import Requests
from humanoid_sim.hardware.robot.table import Sample
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.hardware.robstride.faults import FaultBit, MotorMode, StatusFault, flag_names
from humanoid_sim.hardware.robstride.messages import Stop
from humanoid_sim.hardware.robstride.parameters import fault_word

__all__ = ["mode_text", "stop_and_clear", "stop_motors"]


def mode_text(sample: Sample | None) -> str:
    """What a status says about mode and faults: `mode reset, undervoltage`."""
    if sample is None:
        return "no status"
    faults = flag_names(StatusFault(sample.faults))
    return ", ".join([f"mode {MotorMode(sample.mode).name.lower()}", *faults])


def stop_motors(requests: Requests, joints: Iterable[int], *, clear_faults: bool = False) -> tuple[int, ...]:
    """Stop these joints' motors, and clear their faults if so asked; those that did not confirm it."""
    motor_id = requests.wiring.motor_id
    commands = {i: [Stop(motor_id[i], clear_faults, host_id=requests.host_id)] for i in joints}

    def is_done(sample: Sample) -> bool:
        return sample.mode == MotorMode.RESET and not (clear_faults and sample.faults)

    confirmed = requests.until_status(commands, is_done)
    return tuple(i for i in commands if i not in confirmed)


def stop_and_clear(requests: Requests, access: ParameterAccess, checks: CheckList) -> None:
    """Stop every motor and clear the faults of those that report some; what is left of them is a problem.

    The fault words are asked for as well: they show what no status does, overvoltage.
    """
    wiring, slots = requests.wiring, requests.table.slots
    silent = stop_motors(requests, range(wiring.count))
    words = _fault_words(wiring, access)
    faulty = [i for i, slot in enumerate(slots) if words.get(i) or (slot.sample is not None and slot.sample.faults)]
    for i in faulty:
        checks.warn(wiring.names[i], f"had faults, cleared: {_faults_text(slots[i].sample, words.get(i, 0))}")
    stop_motors(requests, [i for i in faulty if i not in silent], clear_faults=True)
    words = {**words, **_fault_words(wiring, access, faulty)}
    for i, slot in enumerate(slots):
        if i in silent:
            text = f"does not confirm that it is stopped ({mode_text(slot.sample)})"
            checks.problem(wiring.names[i], text)
        elif words.get(i) or (slot.sample is not None and slot.sample.faults):
            checks.problem(wiring.names[i], f"faults do not clear: {_faults_text(slot.sample, words.get(i, 0))}")
        if i not in words:
            checks.warn(wiring.names[i], "its fault word cannot be read: overvoltage would not be seen here")


def _fault_words(wiring: Wiring, access: ParameterAccess, joints: Iterable[int] | None = None) -> dict[int, int]:
    """The fault words of these joints' motors, or of all; those that cannot be read are left out."""
    wanted = range(wiring.count) if joints is None else joints
    found = access.read({i: fault_word(wiring.model[i].name) for i in wanted})
    return {i: int(word) for i, word in found.items() if isinstance(word, float)}


def _faults_text(sample: Sample | None, word: int) -> str:
    status = () if sample is None else flag_names(StatusFault(sample.faults))
    return ", ".join(dict.fromkeys([*status, *flag_names(FaultBit(word))]))
