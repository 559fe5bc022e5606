import math
import random

import numpy as np
import pytest

from humanoid_sim.hardware.adapter.wiring import make_wiring
from humanoid_sim.hardware.bus.events import ChannelNotes
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.motors import MotorGroup
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import encode_command, encode_reply
from humanoid_sim.hardware.robstride.messages import FaultBit, MotorMode, StatusFault, WarningBit, join_identifier
from humanoid_sim.hardware.robstride.motor_table import MotorTable
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS

HOST = 0xFD
RS02 = MOTORS["rs-02"]
NOTHING = StatusFault(0)


PAIR = MotorGroup(
    names=("left", "right"),
    channel=(0, 1),
    motor_id=(11, 21),
    model=(RS02, MOTORS["rs-00"]),
    torque_limit=(0.0, 0.0),
    current_limit=(0.0, 0.0),
)


@pytest.fixture
def table():
    return MotorTable(PAIR, HOST, (ChannelNotes(), ChannelNotes()))


def _status(motor_id=11, host=HOST, position=1.0, mode=MotorMode.RUN, faults=NOTHING, is_report=False):
    return messages.Status(motor_id, host, position, -2.0, 3.0, 36.5, mode, faults, is_report)


def _tell(table, reply, time=1.0, channel=0):
    table.receive(channel, encode_reply(reply, RS02), time)


def _is_unheard(table):
    readings = table.readings()
    arrays = (readings.time, readings.position, readings.velocity, readings.effort, readings.temperature)
    return all(bool(np.isnan(array).all()) for array in arrays)


@pytest.mark.parametrize("is_report", [False, True])
def test_a_status_is_decoded_in_the_motors_frame(table, is_report):
    _tell(table, _status(is_report=is_report), 4.25)
    readings = table.readings()
    assert readings.time[0] == 4.25
    assert readings.position[0] == pytest.approx(1.0, abs=4e-4)
    assert readings.velocity[0] == pytest.approx(-2.0, abs=2e-3)
    assert readings.effort[0] == pytest.approx(3.0, abs=1e-3)
    assert readings.temperature[0] == 36.5
    assert math.isnan(readings.position[1])
    assert (table.slots[0].statuses, table.slots[0].reports) == (1 - is_report, int(is_report))


def test_a_raw_zero_is_exactly_zero(table):
    table.receive(0, Frame(join_identifier(2, 0x80, 11, HOST), b"\x7f\xff\x7f\xff\x7f\xff\0\0"), 1.0)
    readings = table.readings()
    assert (readings.position[0], readings.velocity[0], readings.effort[0]) == (0.0, 0.0, 0.0)


def test_only_a_command_can_be_acknowledged(table):
    _tell(table, _status())
    assert table.slots[0].acknowledged == 0
    table.count_commands()
    table.count_commands()
    for _ in range(3):
        _tell(table, _status())
    _tell(table, _status(is_report=True))
    assert (table.slots[0].commanded, table.slots[0].acknowledged) == (2, 2)


def test_a_version_is_never_a_position(table):
    answers = []
    _tell(table, messages.Version(11, HOST, (0, 2, 3, 6)))
    table.inbox = lambda _channel, reply, _when: answers.append(reply)
    _tell(table, messages.Version(11, HOST, (0, 2, 3, 6)))
    table.receive(0, Frame(join_identifier(2, 0, 11, HOST), b"\0\xc4\x56\0\2\3\6"), 1.0)
    assert answers == [messages.Version(11, HOST, (0, 2, 3, 6))] * 2
    assert _is_unheard(table)
    assert table.slots[0].invalid_frames == 0


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (Frame(join_identifier(2, 0x80, 11, HOST), bytes(7)), "status with 7 bytes, expected 8"),
        (Frame(join_identifier(24, 0x80, 11, HOST), b""), "status with 0 bytes, expected 8"),
        (Frame(join_identifier(21, 0, 11, HOST), bytes(5)), "fault report with 5 bytes, expected 8"),
        (Frame(join_identifier(9, 0x80, 11, HOST), bytes(8)), "frame of communication type 9"),
        (Frame(join_identifier(0, 0, 11, 0xFE), bytes(3)), "device-id reply with 3 bytes, expected 8"),
    ],
)
def test_a_frame_of_a_motor_that_cannot_be_read_is_noted(table, frame, text):
    table.receive(0, frame, 2.5)
    assert table.slots[0].invalid == (2.5, text)
    assert table.slots[0].invalid_frames == 1
    assert _is_unheard(table)


@pytest.mark.parametrize(
    "frame",
    [
        encode_reply(_status(motor_id=12), RS02),
        Frame(join_identifier(2, 0x80, 12, HOST), bytes(3)),
        Frame(0x123, bytes(8), is_extended=False),
        Frame(join_identifier(2, 0x80, 11, HOST), bytes(8), is_extended=False),
        Frame(join_identifier(2, 0x80, 11, HOST), b"", is_remote=True),
        Frame(join_identifier(9, 0x80, 11, 0x55), bytes(8)),
        encode_command(messages.GetDeviceId(11, host_id=0xFE), RS02),
        encode_command(messages.ReadParameter(11, 0x7019, host_id=0xFE), RS02),
        encode_command(messages.Enable(12, host_id=0xFE), RS02),
        encode_reply(_status(host=0xAA, is_report=True), RS02),
    ],
)
def test_a_strangers_frame_is_counted_and_stops_nothing(table, frame):
    table.receive(0, frame, 1.0)
    assert sum(table.notes[0].strangers.values()) == 1
    assert table.notes[0].intrusions == 0
    assert table.slots[0].invalid_frames == 0
    assert _is_unheard(table)


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (messages.OperationControl(11, 0.0, 0.0, 5.0, 0.0, 0.0), "another host sends 'operation control' to motor 11"),
        (messages.Enable(11, host_id=0xFE), "host 0xFE sends 'enable' to motor 11"),
        (messages.Stop(11, host_id=0xAA), "host 0xAA sends 'stop' to motor 11"),
        (messages.SetZero(11, host_id=0xFD), "host 0xFD sends 'set zero' to motor 11"),
    ],
)
def test_another_master_is_noticed_by_its_commands(table, command, text):
    table.receive(0, encode_command(command, RS02), 3.0)
    assert table.notes[0].intruder == (3.0, text)
    assert table.notes[0].intrusions == 1
    assert _is_unheard(table)


def test_a_motor_of_the_other_channel_is_a_stranger(table):
    _tell(table, _status(motor_id=11), channel=1)
    _tell(table, _status(motor_id=21), channel=0)
    assert _is_unheard(table)
    assert [sum(notes.strangers.values()) for notes in table.notes] == [1, 1]


def test_a_fault_between_two_readings_is_kept(table):
    _tell(table, _status(faults=StatusFault.UNDERVOLTAGE), 1.0)
    _tell(table, _status(), 1.01)
    slot = table.slots[0]
    assert slot.sample.status.faults == 0
    assert (slot.alarm.time, slot.alarm.status.faults) == (1.0, StatusFault.UNDERVOLTAGE)


@pytest.mark.parametrize("host", [HOST, 0xFF, 0xFE])
def test_a_fault_report_counts_whomever_it_was_sent_to(table, host):
    _tell(table, messages.FaultReport(11, host, FaultBit.OVERVOLTAGE, WarningBit(0)))
    report = table.slots[0].report
    assert report.faults == FaultBit.OVERVOLTAGE


def test_answers_go_to_whoever_asks(table):
    answers = []
    table.inbox = lambda channel, reply, when: answers.append((channel, reply, when))
    parameter = messages.ParameterReply(11, HOST, 0x7019, b"\0\0\x80\x3f")
    _tell(table, parameter, 1.0)
    _tell(table, messages.DeviceId(99, b"stranger"), 2.0, channel=1)
    assert answers == [(0, parameter, 1.0), (1, messages.DeviceId(99, b"stranger"), 2.0)]
    table.inbox = None
    _tell(table, parameter)
    assert len(answers) == 2


LITE = make_wiring(load_robot("lite"), 2, dict.fromkeys(load_robot("lite").joint_names, 0.0))


def _may_be_heard(frame, channel):
    """The joint that a frame is a status of, by the protocol's words alone."""
    kind, low, destination = frame.arbitration_id >> 24, frame.arbitration_id >> 8 & 0xFF, frame.arbitration_id & 0xFF
    is_status = frame.is_extended and not frame.is_remote and kind in {2, 24} and len(frame.data) == 8
    if not is_status or destination != HOST or frame.data[:3] == b"\0\xc4\x56":
        return None
    for joint, (motor_id, on) in enumerate(zip(LITE.motor_id, LITE.channel, strict=True)):
        if (motor_id, on) == (low, channel):
            return joint
    return None


def _check_only_heard_joints_are_known(table, heard):
    readings = table.readings()
    known = {int(joint) for joint in np.flatnonzero(np.isfinite(readings.position))}
    assert known == heard
    assert {int(joint) for joint in np.flatnonzero(np.isfinite(readings.time))} == heard
    assert (np.abs(readings.position[sorted(heard)]) <= 4.0 * math.pi * 1.0001).all()


def random_frame(generator):
    """Like `frames`, millions of times."""
    if generator.random() < 0.2:
        identifier = generator.getrandbits(29)
    else:
        identifier = join_identifier(
            generator.choice((0, 1, 2, 2, 2, 3, 4, 6, 7, 17, 18, 21, 22, 23, 24, 24, 25, 9, 31)),
            generator.getrandbits(8),
            generator.choice((*LITE.motor_id, 99, 0, 127, 255)),
            generator.choice((HOST, HOST, 0xFE, 0xFF, 0, 11, 127)),
        )
    length = generator.choice((8, 8, 8, 8, 7, 0, generator.randrange(9)))
    return Frame(identifier, generator.randbytes(length), generator.random() < 0.95, generator.random() < 0.02)


def _fuzz(seconds, least_frames, seed):
    import time  # noqa: PLC0415 - the deadline of the long run

    generator = random.Random(seed)
    deadline, count = time.monotonic() + seconds, 0
    while count < least_frames or time.monotonic() < deadline:
        table, heard = MotorTable(LITE, HOST, (ChannelNotes(), ChannelNotes())), set[int]()
        table.inbox = lambda *_: None
        for _ in range(200):
            channel, frame = generator.randrange(2), random_frame(generator)
            table.receive(channel, frame, 1.0)
            if (joint := _may_be_heard(frame, channel)) is not None:
                heard.add(joint)
        _check_only_heard_joints_are_known(table, heard)
        count += 200
    return count


def test_many_random_frames():
    assert _fuzz(0.0, 20_000, 1) == 20_000


@pytest.mark.soak
def test_random_frames_for_minutes(fuzzing_seconds):
    seed = random.SystemRandom().getrandbits(32)
    print(f"seed {seed}: {_fuzz(fuzzing_seconds, 1, seed)} frames")
