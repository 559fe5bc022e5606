"""Motors that answer operation control to another host than the one that commands them.

The frame of type 1 has no room for a host's id; where the motor takes that from is not documented, and there is one
stored in it. A motor that answers a stored host would run, and never be heard.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.robstride.commands import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.messages import OperationControl
from humanoid_sim.hardware.robstride.requests import Requests

__all__ = ["check_stored_hosts", "limp_command", "note_stored_hosts"]

_ANSWER_TIME = 0.05
"""s in which a stopped motor answers operation control, if it does at all."""


def check_stored_hosts(channels: RobstrideLink, joints: Sequence[int], checks: CheckList) -> None:
    """Ask these motors, which are stopped, with a command that exerts nothing; those that answer another host.

    One that does not answer while it is stopped is found out when it is enabled: `note_stored_hosts`.
    """
    slots = channels.table.slots
    before = {i: slots[i].statuses for i in joints}
    for i in joints:
        slots[i].answers_to = None
    channels.table.expects_strays = True
    try:
        channels.requests.send({i: [limp_command(channels.requests, i)] for i in joints})
        channels.line.wait(
            lambda: all(slots[i].statuses > before[i] or slots[i].answers_to is not None for i in joints), _ANSWER_TIME
        )
    finally:
        channels.table.expects_strays = False
    note_stored_hosts(channels.requests, joints, checks)


def note_stored_hosts(requests: Requests, joints: Iterable[int], checks: CheckList) -> None:
    """Those of these motors that have answered another host since they were asked are a problem."""
    for i in joints:
        host = requests.table.slots[i].answers_to
        if host is None:
            continue
        ours = requests.host_id
        start = f"start with --host-id {host}, or " if host > LARGEST_MOTOR_ID else ""
        checks.problem(
            requests.motors.names[i],
            f"answers operation control to host {host}, which is stored in the motor, and not to {ours}, this host: "
            f"{start}store {ours} in it (CAN_MASTER, with the vendor's program)",
        )


def limp_command(requests: Requests, joint: int) -> OperationControl:
    """A command without gains or effort, at the motor's position if that is known."""
    sample = requests.table.slots[joint].sample
    position = 0.0 if sample is None else sample.status.position
    return OperationControl(requests.motors.motor_id[joint], position, 0.0, 0.0, 0.0, 0.0)
