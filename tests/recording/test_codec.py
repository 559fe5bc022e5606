"""The tick message: every bit of a tick, in a form that a generic ROS 2 reader understands."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_samples import any_float, any_text, make_tick, tick_records
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from humanoid_sim.messages import Event, EventKind
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.recording.codec import INTENT_CODES, decode_event, decode_tick, encode_event, encode_tick
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.definitions import TICK, schema_text
from humanoid_sim.testing.properties import fingerprint


@pytest.fixture(scope="module")
def typestore():
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(TICK), TICK))
    return store


@given(tick_records())
def test_every_bit_comes_back_and_a_generic_reader_agrees(typestore, record):
    data = encode_tick(record)
    assert fingerprint(decode_tick(data)) == fingerprint(record)
    message = typestore.deserialize_cdr(data, TICK)
    given, output = record.input, record.output
    state, control = given.state, output.control_mode
    numbers = {"time": state.time, "duration": record.duration, "qpos": () if record.qpos is None else record.qpos}
    for name in ("joint_position", "joint_velocity", "joint_effort", "joint_age", "imu_quaternion"):
        numbers[name] = getattr(state, name)
    numbers |= {f"command_{name}": getattr(output.command, name) for name in COMMAND_FIELDS}
    for name, values in numbers.items():
        assert np.asarray(getattr(message, name)).tobytes() == np.asarray(values, np.float64).tobytes(), name
    assert (message.index, message.mode, message.policy) == (record.index, control.mode, given.policy)
    assert (message.controller_name, message.status_message) == (control.controller_name, control.status_message)
    assert message.has_qpos == (record.qpos is not None)
    assert list(message.intents) == [INTENT_CODES[intent] for intent in given.intents]
    for found, expected in ((message.safety, given.safety), (message.faults, output.faults)):
        assert [one.message for one in found] == [one.message for one in expected]
    assert list(message.policy_error) == ([] if output.policy_error is None else [output.policy_error])
    assert [one.name for one in message.extern] == list(state.extern)
    assert len(message.remote) == (given.remote is not None)
    assert [step.frame for step in message.policy_step] == ([output.policy_step.frame] if output.policy_step else [])


@given(st.binary(max_size=40), st.integers(0, 700), tick_records(joints=2))
def test_garbage_is_refused_or_a_whole_tick(garbage, position, record):
    message = encode_tick(record)
    try:
        decoded = decode_tick(message[:position] + garbage + message[position + len(garbage) :])
    except CdrError:
        return
    assert fingerprint(decode_tick(encode_tick(decoded))) == fingerprint(decoded)


@given(any_float, any_text, st.sampled_from(EventKind))
def test_an_event_comes_back(time, text, kind):
    assert fingerprint(decode_event(encode_event(Event(time, text, kind)))) == fingerprint(Event(time, text, kind))


def test_numbers_of_events_and_the_fields_that_came_with_the_second_format_stay():
    names = "NOTE FRESH_START SUPPORT FAILURE LOSS ENDING FALL PUSH"
    assert [(kind.name, kind.value) for kind in EventKind] == [(name, i) for i, name in enumerate(names.split())]
    event = encode_event(Event(1.5, "ab", EventKind.SUPPORT))
    assert event.hex(" ") == "00 01 00 00 00 00 00 00 00 00 f8 3f 03 00 00 00 61 62 00 02"
    plain, failed = (encode_tick(make_tick(40, policy_error=error)) for error in (None, "no"))
    assert plain[-9:].hex(" ") == "00 00 00 00 01 00 00 00 00", "no error, no policy selected"
    assert failed.removeprefix(plain[:-9]).hex(" ") == "01 00 00 00 03 00 00 00 6e 6f 00 00 01 00 00 00 00"
    assert fingerprint(decode_tick(plain[:-5])) == fingerprint(make_tick(40)), (
        "as recordings without the last field have it"
    )
