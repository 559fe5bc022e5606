import re
import time

import numpy as np
import pytest
import rig

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent
from humanoid_sim.mit import VELOCITY_COMMAND
from humanoid_sim.session.sources import VELOCITY_KEYS, IntentQueue, RemoteInbox, VelocityCommand, parse_velocity


def test_an_intent_that_waited_for_the_loop_too_long_is_left_out_unless_it_damps():
    told = []
    queue = IntentQueue(told.append)
    long_ago = monotonic_ns() - 600_000_000
    for intent in (Intent.LOAD_A, Intent.DAMP, Intent.QUIT):
        queue.put(intent, long_ago)
    queue.put(Intent.LOAD_A, time.time_ns())  # of another clock: such a stamp would never grow old
    queue.put(Intent.LOAD_B, monotonic_ns())
    assert list(queue.poll(0.0, None)) == [Intent.DAMP, Intent.LOAD_B]
    assert [line.split(":")[0] for line in told] == ["LOAD_A refused", "QUIT refused", "LOAD_A refused"]
    assert "is in the future" in told[2]


def inbox(time):
    return RemoteInbox(rig.JOINTS, lambda: time[0])


def test_a_command_is_stamped_with_the_robots_clock_at_its_arrival():
    time = [3.0]
    box = inbox(time)
    assert box.latest() is None
    command = rig.command()
    box.put(rig.JOINTS, command)
    time[0] = 9.0
    latest = box.latest()
    assert latest.command is command
    assert latest.arrival_time == 3.0
    newer = rig.command(0.1)
    box.put(list(rig.JOINTS), newer)
    assert box.latest().command is newer
    assert box.latest().arrival_time == 9.0
    assert (box.accepted, box.rejected) == (2, 0)


RANGES = np.array([[-0.5, 1.0], [-0.5, 0.5], [-1.0, 1.0]])


QUESTIONED = "0,0,30", np.array([[-0.5, 1.0], [0.0, 0.0], [-1.0, 1.0]])


@pytest.mark.parametrize(
    ("text", "ranges", "problem"),
    [
        *(
            (text, None, f"is '{text}', expected vx,vy,wz")
            for text in ("", "1", "1,2", "1,2,3,4", "a,b,c", "nan,0,0", "0,inf,0")
        ),
        ("1.1,0,0", RANGES, "vx is "),
        ("0,-0.6,0", RANGES, "vy is "),
        ("0,0,2", RANGES, "wz is "),
        (*QUESTIONED, "wz is 30 rad/s, expected -1 to 1 rad/s; that is what the policy"),
        ("0,0,30", None, "wz is 30 rad/s, expected -12.57 to 12.57 rad/s; is it in degrees per second?"),
        ("50,0,0", None, "vx is 50 m/s, expected -10 to 10 m/s; is it in cm/s"),
    ],
)
def test_anything_else_or_beyond_what_is_known_is_refused_and_its_unit_questioned(text, ranges, problem):
    with pytest.raises(InputError, match=f"^--command: {re.escape(problem)}"):
        parse_velocity(text, ranges)


def test_every_direction_has_its_keys_and_the_command_does_not_grow_old():
    live = VelocityCommand(np.array([0.5, 0.0, 0.0])).latest()[VELOCITY_COMMAND]
    assert live.at(1e6).tolist() == [0.5, 0.0, 0.0]
    keys = {}
    for key, change in VELOCITY_KEYS.items():
        keys.setdefault(change, []).append(key)
    assert keys == {
        (0.1, 0.0, 0.0): ["w", "up"],
        (-0.1, 0.0, 0.0): ["s", "down"],
        (0.0, 0.1, 0.0): [","],
        (0.0, -0.1, 0.0): ["."],
        (0.0, 0.0, 0.1): ["j", "left"],
        (0.0, 0.0, -0.1): ["k", "right"],
        (0.0, 0.0, 0.0): ["0"],
    }
