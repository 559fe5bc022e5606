"""The tick message: every bit of a tick, in a form that a generic ROS 2 reader understands."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_samples import any_float, any_text, bits, make_tick, tick_records
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from humanoid_sim.messages import Event, EventKind
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.recording.codec import INTENT_CODES, decode_event, decode_tick, encode_event, encode_tick
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.definitions import TICK, schema_text


@pytest.fixture(scope="module")
def typestore():
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(TICK), TICK))
    return store


@given(tick_records())
def test_round_trip(record):
    assert bits(decode_tick(encode_tick(record))) == bits(record)


@given(tick_records())
def test_a_generic_reader_agrees(typestore, record):
    message = typestore.deserialize_cdr(encode_tick(record), TICK)
    state, output, remote = record.input.state, record.output, record.input.remote

    def same(values, expected):
        return np.asarray(values).tobytes() == np.asarray(expected).tobytes()

    assert message.index == record.index
    assert same((message.time, message.duration), (state.time, record.duration))
    for name in ("joint_position", "joint_velocity", "joint_effort", "joint_age", "imu_quaternion"):
        assert same(getattr(message, name), getattr(state, name))
    for name in COMMAND_FIELDS:
        assert same(getattr(message, f"command_{name}"), getattr(output.command, name))
    control = output.control_mode
    assert (message.mode, message.controller_name) == (control.mode, control.controller_name)
    assert message.status_message == control.status_message
    assert message.has_qpos == (record.qpos is not None)
    assert same(message.qpos, () if record.qpos is None else record.qpos)
    assert [status.message for status in message.safety] == [status.message for status in record.input.safety]
    assert list(message.intents) == [INTENT_CODES[intent] for intent in record.input.intents]
    assert [fault.message for fault in message.faults] == [fault.message for fault in output.faults]
    assert list(message.policy_error) == ([] if output.policy_error is None else [output.policy_error])
    assert message.policy == record.input.policy
    assert len(message.remote) == (remote is not None)
    assert [e.name for e in message.extern] == list(state.extern)
    for read, step in zip(message.policy_step, [output.policy_step], strict=False):
        assert read.frame == step.frame
        assert same(read.action, step.action)


@given(st.binary(max_size=40), st.integers(0, 700), tick_records(joints=2))
def test_garbage_is_refused_or_a_whole_tick(garbage, position, record):
    message = encode_tick(record)
    try:
        decoded = decode_tick(message[:position] + garbage + message[position + len(garbage) :])
    except CdrError:
        return
    assert bits(decode_tick(encode_tick(decoded))) == bits(decoded)


@given(any_float, any_text, st.sampled_from(EventKind))
def test_an_event_comes_back(time, text, kind):
    assert bits(decode_event(encode_event(Event(time, text, kind)))) == bits(Event(time, text, kind))


def test_the_fields_that_came_with_the_second_format_stay_where_they_are():
    event = encode_event(Event(1.5, "ab", EventKind.SUPPORT))
    assert event.hex(" ") == "00 01 00 00 00 00 00 00 00 00 f8 3f 03 00 00 00 61 62 00 02"
    plain, failed = (encode_tick(make_tick(40, policy_error=error)) for error in (None, "no"))
    assert plain[-9:].hex(" ") == "00 00 00 00 01 00 00 00 00", "no error, no policy selected"
    assert failed.removeprefix(plain[:-9]).hex(" ") == "01 00 00 00 03 00 00 00 6e 6f 00 00 01 00 00 00 00"
    assert bits(decode_tick(plain[:-5])) == bits(make_tick(40)), "as recordings without the last field have it"
