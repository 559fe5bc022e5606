from __future__ import annotations

import numpy as np
import pytest
import rig

from humanoid_sim.errors import FieldError
from humanoid_sim.session.remote import RemoteInbox


def inbox(time: list[float]) -> RemoteInbox:
    return RemoteInbox(rig.JOINTS, lambda: time[0])


def test_a_command_is_stamped_with_the_robots_clock_at_its_arrival() -> None:
    time = [3.0]
    box = inbox(time)
    assert box.latest() is None
    command = rig.command()
    box.put(rig.JOINTS, command)
    time[0] = 9.0
    latest = box.latest()
    assert latest is not None
    assert latest.command is command
    assert latest.arrival_time == 3.0
    newer = rig.command(0.1)
    box.put(list(rig.JOINTS), newer)
    assert box.latest().command is newer  # type: ignore[union-attr]
    assert box.latest().arrival_time == 9.0  # type: ignore[union-attr]
    assert (box.accepted, box.rejected) == (2, 0)


@pytest.mark.parametrize(
    ("names", "command", "message"),
    [
        (
            ("elbow", "shoulder", "wrist"),
            rig.command(),
            "joint_names are elbow, shoulder, wrist, expected shoulder, el",
        ),
        (("shoulder", "elbow"), rig.command(), "joint_names are shoulder, elbow, expected"),
        ((), rig.command(), "joint_names are missing, expected"),
        (rig.JOINTS, rig.command(n=2), r"^remote command has shape \(2,\), expected \(3,\)"),
        (rig.JOINTS, rig.command(effort=np.array([0.0, np.nan, 0.0])), "effort of elbow is nan"),
        (rig.JOINTS, rig.command(stiffness=np.array([np.inf, 0.0, 0.0])), "stiffness of shoulder is inf"),
        (rig.JOINTS, rig.command(damping=np.array([-1.0, 0.0, 0.0])), "damping of shoulder is -1"),
        (rig.JOINTS, rig.command(stiffness=np.array([0.0, 0.0, -1.0])), "stiffness of wrist is -1"),
    ],
)
def test_a_command_that_does_not_fit_is_refused_and_the_last_one_stays(names, command, message) -> None:
    box = inbox([1.0])
    good = rig.command()
    box.put(rig.JOINTS, good)
    with pytest.raises(FieldError, match=message):
        box.put(names, command)
    assert box.latest().command is good  # type: ignore[union-attr]
    assert (box.accepted, box.rejected) == (1, 1)
