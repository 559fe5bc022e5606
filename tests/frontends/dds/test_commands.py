"""What a command is that came over DDS, and how old."""

from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.dds.commands import DEPTH, ArrivalClock, CommandReader, read_command
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand
from humanoid_sim.ros2.cdr import CdrWriter
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Reader, Writer
from humanoid_sim.ros2.messages import encode_mit_command
from humanoid_sim.ros2.topics import COMMAND_TOPIC, TOPICS

ONE, OTHER = 1, 2


JOINTS = ("shoulder", "elbow", "wrist")
SOUND = dict(zip(COMMAND_FIELDS, ([0.1, 0.2, 0.3], [0.0] * 3, [1.0, -1.0, 0.0], [20.0] * 3, [1.0] * 3), strict=True))


def message(names=JOINTS, **fields):
    """Of fields that need not fit."""
    writer = CdrWriter()
    writer.pack("iI", -5, 4_000_000_000)  # a stamp that no clock shows
    writer.string("nowhere")
    writer.strings(names)
    for values in (SOUND | fields).values():
        writer.array(np.array(values, dtype=np.float64))
    return writer.message()


def test_a_command_is_read():
    command = read_command(message() + b"\0\0\0", JOINTS)  # some writers pad
    for name, values in SOUND.items():
        assert getattr(command, name).tolist() == values
    again = MITCommand(*(np.array(values) for values in SOUND.values()))
    assert read_command(encode_mit_command(0, JOINTS, again), JOINTS).effort.tolist() == [1.0, -1.0, 0.0]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (message(("shoulder", "wrist", "elbow")), "joint_names are shoulder, wrist, elbow, expected shoulder, elbow, "),
        (message(("shoulder", "elbow")), "joint_names are shoulder, elbow, expected shoulder, elbow, wrist in this"),
        (message(()), "joint_names are missing, expected shoulder"),
        (message(("x" * 100_000,)), f"joint_names are {'x' * 400} …, expected shoulder"),
        (message(velocity=[0.0] * 4), r"velocity: shape is (4,), expected (3,)"),
        (message(damping=[]), "damping: shape is (0,), expected (3,)"),
        (message(**{name: [0.0] * 2 for name in COMMAND_FIELDS}), "command has shape (2,), expected (3,)"),
        (message(effort=[0.0, float("nan"), 0.0]), "effort of elbow is nan"),
        (message(velocity=[float("-inf"), 0.0, 0.0]), "velocity of shoulder is -inf"),
        (message(position=[1e300, 0.0, 0.0]), "position of shoulder is 1e+300"),
        (message(stiffness=[20.0, 20.0, -1.0]), "stiffness of wrist is -1.0"),
        (b"", "encapsulation header is missing"),
        (b"\0\0\0\0" + message()[4:], "encapsulation header is 00 00 00 00"),
        (message() + bytes(4), "4 bytes left after the last field"),
        (message()[:24] + b"\xff\xff\xff\x7f" + message()[28:], "a sequence of 2147483647 elements"),
    ],
)
def test_what_is_no_command_is_refused_in_one_short_line(data, reason):
    with pytest.raises(FieldError) as refused:
        read_command(data, JOINTS)
    assert reason in str(refused.value)
    assert len(str(refused.value)) < 600
    assert "\n" not in str(refused.value)


@pytest.mark.skipif(find_spec("cyclonedds") is None, reason="cyclonedds is not installed (dds)")
@pytest.mark.parametrize("flood", [message(position=[0.9] * 3), message(("somebody", "else"))])
def test_one_writers_flood_pushes_no_other_writers_command_out(flood, domain, local, monkeypatch):
    kind = TOPICS[COMMAND_TOPIC]
    with Participant(domain) as joined:
        reader = CommandReader(local.info, JOINTS, joined, Reader(joined, COMMAND_TOPIC, kind, depth=DEPTH), (), {})
        honest, other = (Writer(joined, COMMAND_TOPIC, kind) for _ in range(2))
        sent = []
        intake = SimpleNamespace(remote=lambda *given, **_: sent.append(given[1][0]))
        monkeypatch.setattr(reader, "_intake", lambda _: intake)
        for count in (0, 1000, 1000):  # between two looks
            assert honest.write(message())
            for _ in range(count):
                other.write(flood)
            reader._take_commands(ArrivalClock(monotonic_ns()))
        assert sent.count(0.1) == 3
        assert sent.count(0.9) <= 2, "the newest of each writer"
        assert reader._refused <= 2 * 64, "and a flood costs a bounded time"
