import re
import threading
import time

import numpy as np
import pytest
import rig

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.messages import Intent
from humanoid_sim.mit import VELOCITY_COMMAND
from humanoid_sim.session.sources import VELOCITY_KEYS, IntentQueue, RemoteInbox, VelocityCommand, parse_velocity


def test_an_intent_queue_gives_everything_once_and_in_order():
    queue = IntentQueue()
    assert list(queue.poll(0.0, None)) == []
    for intent in (Intent.LOAD_A, Intent.DAMP, Intent.DAMP):
        queue.put(intent)
    assert list(queue.poll(0.0, None)) == [Intent.LOAD_A, Intent.DAMP, Intent.DAMP]
    assert list(queue.poll(0.0, None)) == []
    assert not queue.finished


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


def test_an_intent_queue_loses_nothing_between_threads():
    queue = IntentQueue()
    count, kinds = 5000, list(Intent)[:4]
    got = []

    def send(intent):
        for _ in range(count):
            queue.put(intent)

    threads = [threading.Thread(target=send, args=(intent,)) for intent in kinds]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        got += queue.poll(0.0, None)
    got += queue.poll(0.0, None)
    for thread in threads:
        thread.join()
    assert {intent: got.count(intent) for intent in kinds} == dict.fromkeys(kinds, count)


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
def test_a_command_that_does_not_fit_is_refused_and_the_last_one_stays(names, command, message):
    box = inbox([1.0])
    good = rig.command()
    box.put(rig.JOINTS, good)
    with pytest.raises(FieldError, match=message):
        box.put(names, command)
    assert box.latest().command is good
    assert (box.accepted, box.rejected) == (1, 1)


RANGES = np.array([[-0.5, 1.0], [-0.5, 0.5], [-1.0, 1.0]])


def test_three_numbers():
    assert parse_velocity(" 0.5, -0.25,1", RANGES).tolist() == [0.5, -0.25, 1.0]
    assert parse_velocity("3,-1,2", None).tolist() == [3.0, -1.0, 2.0]


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
