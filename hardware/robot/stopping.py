"""Stop motors, clear their faults, enable them: each verified by the mode that the motor then reports."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from humanoid_sim.hardware.robot.checks import CheckList
from humanoid_sim.hardware.robot.requests import Requests
from humanoid_sim.hardware.robot.table import Sample
from humanoid_sim.hardware.robstride.faults import MotorMode, StatusFault, flag_names
from humanoid_sim.hardware.robstride.messages import Command, Enable, OperationControl, Stop

__all__ = ["enable_motors", "mode_text", "stop_and_clear", "stop_motors"]


def mode_text(sample: Sample | None) -> str:
    """What a status says about mode and faults: `mode reset, undervoltage`."""
    if sample is None:
        return "no status"
    faults = flag_names(StatusFault(sample.faults))
    return ", ".join([f"mode {MotorMode(sample.mode).name.lower()}", *faults])


def stop_motors(requests: Requests, joints: Iterable[int], *, clear_faults: bool = False) -> tuple[int, ...]:
    """Stop these joints' motors; those that did not confirm it."""
    motor_id = requests.wiring.motor_id
    commands = {i: [Stop(motor_id[i], clear_faults, host_id=requests.host_id)] for i in joints}
    confirmed = requests.until_status(commands, lambda sample: sample.mode == MotorMode.RESET)
    return tuple(i for i in commands if i not in confirmed)


def stop_and_clear(requests: Requests, checks: CheckList) -> None:
    """Stop every motor and clear the faults of those that report some; what is left of them is a problem."""
    wiring, slots = requests.wiring, requests.table.slots
    silent = stop_motors(requests, range(wiring.count))
    faulty = [i for i, slot in enumerate(slots) if slot.sample is not None and slot.sample.faults]
    for i in faulty:
        checks.warn(wiring.names[i], f"had faults, cleared: {mode_text(slots[i].sample)}")
    silent += stop_motors(requests, [i for i in faulty if i not in silent], clear_faults=True)
    for i in silent:
        checks.problem(wiring.names[i], f"does not confirm that it is stopped ({mode_text(slots[i].sample)})")
    for i, slot in enumerate(slots):
        if slot.sample is not None and slot.sample.faults:
            checks.problem(wiring.names[i], f"faults do not clear ({mode_text(slot.sample)})")


def enable_motors(requests: Requests, position: Sequence[float], checks: CheckList) -> None:
    """Enable every motor, without torque; one that does not run afterwards is a problem.

    A command without gains or effort goes before and after each enable: some firmware keeps its last command, and
    nobody knows what the last program that talked to this motor wanted of it.

    Args:
        requests: asks.
        position: rad, motor frame, where each motor is.
        checks: takes the problems.
    """
    wiring, slots = requests.wiring, requests.table.slots
    commands: dict[int, list[Command]] = {}
    for i, motor_id in enumerate(wiring.motor_id):
        limp = OperationControl(motor_id, position[i], 0.0, 0.0, 0.0, 0.0)
        commands[i] = [limp, Enable(motor_id, host_id=requests.host_id), limp]
    running = requests.until_status(commands, lambda sample: sample.mode == MotorMode.RUN and not sample.faults)
    for i in commands:
        if i not in running:
            checks.problem(wiring.names[i], f"was not enabled ({mode_text(slots[i].sample)})")
