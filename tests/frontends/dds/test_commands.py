"""Commands and statuses that come over DDS: what is refused, how often, and how old."""

from math import inf
from types import SimpleNamespace

import numpy as np
import pytest

from humanoid_sim.controllers.contract import LiveTopic
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.dds import commands as module
from humanoid_sim.frontends.dds.commands import CommandReader, StatusForwarder, read_command
from humanoid_sim.messages import SafetyLevel, SafetyStatus
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.ros2.cdr import CdrError, encode
from humanoid_sim.ros2.dds.endpoints import Received
from humanoid_sim.ros2.definitions import MIT_COMMAND
from humanoid_sim.ros2.messages import SESSION_FRAME, encode_float32_array

JOINTS = ("shoulder", "elbow", "wrist")
SOUND = dict(zip(COMMAND_FIELDS, ([0.1, 0.2, 0.3], [0.0] * 3, [1.0, -1.0, 0.0], [20.0] * 3, [1.0] * 3), strict=True))


def message(names=JOINTS, **fields):
    """Of fields that need not fit."""
    no_time = (-5, 4_000_000_000)  # that any clock shows
    return encode(MIT_COMMAND, no_time, "nowhere", names, *(SOUND | fields).values())


def test_a_command_is_read():
    command = read_command(message() + b"\0\0\0", JOINTS)  # some writers pad
    assert {name: getattr(command, name).tolist() for name in SOUND} == SOUND


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (message(("shoulder", "wrist", "elbow")), "joint_names are shoulder, wrist, elbow, expected shoulder, elbow, "),
        (message(("x" * 100_000,)), f"joint_names are {'x' * 400}, expected shoulder"),
        (message(velocity=[0.0] * 4), r"velocity: shape is (4,), expected (3,)"),
        (message(**{name: [0.0] * 2 for name in COMMAND_FIELDS}), "command has shape (2,), expected (3,)"),
        (message(effort=[0.0, float("nan"), 0.0]), "effort of elbow is nan"),
        (message(stiffness=[20.0, 20.0, -1.0]), "stiffness of wrist is -1.0"),
        (message()[:24] + b"\xff\xff\xff\x7f" + message()[28:], "a string of"),
    ],
)
def test_what_is_no_command_is_refused_in_one_short_line(data, reason):
    with pytest.raises((FieldError, CdrError)) as refused:
        read_command(data, JOINTS)
    assert reason in str(refused.value)
    assert len(str(refused.value)) < 600


def test_a_fault_is_forwarded_at_once_and_a_flood_twenty_times_a_second():
    reported = []
    intake = SimpleNamespace(post_safety=lambda name, level, *_, **__: reported.append((name, level)))
    forwarder = StatusForwarder(intake)
    for number in range(100):
        forwarder.take("", SafetyStatus(SafetyLevel(number % 2), source="lidar"))
        forwarder.flush(0, 0.001 * number)
    assert reported[:2] == [("lidar", 0), ("lidar", 1)], "the first fault"
    assert len(reported) <= 8
    for level in (SafetyLevel.WARNING, SafetyLevel.OK):
        forwarder.take("", SafetyStatus(level, source="glitch"))
    forwarder.take(SESSION_FRAME, SafetyStatus(SafetyLevel.FAULT, source="can0"))
    for now in (1.0, 1.01, 1.06):
        forwarder.flush(0, now)
    assert reported[-2:] == [("glitch", 1), ("glitch", 0)], "a fault that ends within one poll still damps"
    assert "can0" not in dict(reported), "what a session publishes does not come back"


@pytest.mark.parametrize(("timeout", "gap", "taken"), [(0.5, 0.01, 1), (0.5, 0.06, 0), (inf, 0.06, 1)])
def test_what_came_while_the_bridge_was_suspended_is_dropped_unless_it_is_latched(monkeypatch, timeout, gap, taken):
    """A latched one comes once, and as soon as the bridge is there, which takes its time to start."""
    samples, now, sent = {"/goal": [Received(encode_float32_array(np.zeros(2)), 1)]}, [0], []

    class FakeReader:
        def __init__(self, _, topic, *__, **___):
            self.topic = topic

        def wait(self, _):
            now[0] += round(1e9 * gap)

        def take(self):
            return samples.pop(self.topic, [])

    monkeypatch.setattr(module, "Reader", FakeReader)
    monkeypatch.setattr(module, "monotonic_ns", lambda: now[0])
    contract = SimpleNamespace(live_topics={"goal": LiveTopic("/goal", timeout)})
    monkeypatch.setattr(module, "recorded_contracts", lambda _: (contract,))
    intake = SimpleNamespace(live=lambda *_, stamp: sent.append(stamp))
    header = SimpleNamespace(joint_names=JOINTS)
    attachment = SimpleNamespace(session=None, intake=intake, header=header, live_inputs={"goal": 2})
    CommandReader(attachment, None, is_local=True).poll(0.0)
    assert sent == [0] * taken
