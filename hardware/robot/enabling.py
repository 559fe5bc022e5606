"""Enable motors, without torque, and make sure that they are still those that were configured."""

from __future__ import annotations

import time
from collections.abc import Sequence

from humanoid_sim.hardware.robot.checks import CheckList
from humanoid_sim.hardware.robot.requests import Requests
from humanoid_sim.hardware.robot.stopping import mode_text
from humanoid_sim.hardware.robot.table import Sample
from humanoid_sim.hardware.robstride.faults import MotorMode
from humanoid_sim.hardware.robstride.messages import Command, Enable, OperationControl, ParameterReply, ReadParameter
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, CanTimeout, unpack_value

__all__ = ["enable_motors"]

_LONGEST = 1.0
"""s in which every motor must run and have confirmed its CAN timeout."""
_PERIOD = 0.02
"""s between two rounds of commands meanwhile, well within the CAN timeout."""
_POLL = 0.001
"""s"""
_TIMEOUT = PARAMETERS["canTimeout"]


def enable_motors(requests: Requests, position: Sequence[float], can_timeout: float, checks: CheckList) -> None:
    """Enable every motor, without torque; one that does not run afterwards, or has booted meanwhile, is a problem.

    A command without gains or effort goes before and after each enable: some firmware keeps its last command, and
    nobody knows what the last program that talked to this motor wanted of it. The same command goes on to those that
    run already, or their CAN timeout would stop them while others are still asked. The timeout is read back once more
    from each motor that runs: one whose supply failed for a moment since it was configured has lost it, and would
    execute its last command for ever.

    Args:
        requests: asks.
        position: rad, motor frame, where each motor is.
        can_timeout: s, what was written.
        checks: takes the problems.
    """
    wiring, slots = requests.wiring, requests.table.slots
    joints = range(wiring.count)
    before = [slot.sample for slot in slots]
    ticks = CanTimeout.to_ticks(can_timeout)
    confirmed: dict[int, float] = {}
    requests.received()
    deadline = time.monotonic() + _LONGEST
    while True:
        running = [i for i in joints if slots[i].sample is not before[i] and _runs(slots[i].sample)]
        confirmed = {i: found for i, found in confirmed.items() if i in running}
        if len(confirmed) == wiring.count or time.monotonic() > deadline:
            break
        commands: dict[int, list[Command]] = {}
        for i in joints:
            motor_id = wiring.motor_id[i]
            limp = OperationControl(motor_id, position[i], 0.0, 0.0, 0.0, 0.0)
            if i not in running:
                commands[i] = [limp, Enable(motor_id, host_id=requests.host_id), limp]
            elif i not in confirmed:
                commands[i] = [limp, ReadParameter(motor_id, _TIMEOUT.index, host_id=requests.host_id)]
            else:
                commands[i] = [limp]
        for joint, group in commands.items():  # one motor after the other: no other's frames between enable and limp
            requests.send({joint: group})
        _listen(requests, running, confirmed)
    for i in joints:
        name = wiring.names[i]
        if i not in running:
            checks.problem(name, f"was not enabled ({mode_text(slots[i].sample)})")
        elif i not in confirmed:
            checks.problem(name, "does not tell its CAN timeout after it was enabled")
        elif confirmed[i] != ticks:
            checks.problem(name, f"has booted since it was configured: its canTimeout reads {confirmed[i]:g}")


def _listen(requests: Requests, asked: Sequence[int], confirmed: dict[int, float]) -> None:
    """Take answers for one round, or until all that were asked have answered."""
    end = time.monotonic() + _PERIOD
    while time.monotonic() < end:
        for joint, reply in requests.received():
            if joint in asked and isinstance(reply, ParameterReply) and reply.index == _TIMEOUT.index:
                confirmed[joint] = float(unpack_value(_TIMEOUT.type, reply.payload)) if reply.is_success else -1.0
        if len(confirmed) == requests.wiring.count:
            return
        time.sleep(_POLL)


def _runs(sample: Sample | None) -> bool:
    return sample is not None and sample.mode == MotorMode.RUN and not sample.faults
