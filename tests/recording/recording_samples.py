"""Sample headers and ticks, and Hypothesis strategies for them."""

import struct

import numpy as np
from hypothesis import strategies as st

from humanoid_sim import messages
from humanoid_sim.mit import Extern, MITCommand, MITState
from humanoid_sim.recording.recorder import McapRecorder

JOINTS = ("shoulder", "elbow", "wrist")
START_NS = 1_700_000_000_000_000_000
PERIOD = 0.005


def make_header(**changes) -> messages.SessionHeader:
    fields = {
        "robot": "lite",
        "joint_names": JOINTS,
        "control_period": PERIOD,
        "start_time_ns": START_NS,
        "documents": {"robot": '{"name": "lité"}', "settings": "{}"},
        "attachments": {"motion.mcap": bytes(range(256))},
        "observation_terms": (("joint_pos", 3), ("actions", 2)),
    }
    return messages.SessionHeader(**fields | changes)


def make_tick(index: int, **output) -> messages.TickRecord:
    """A tick of a plausible run: STANDBY at first, then a policy at 50 Hz."""
    rng = np.random.default_rng(index)
    time = index * PERIOD
    state = MITState(time, *rng.normal(size=(4, 3)), rng.normal(size=4), rng.normal(size=3), rng.normal(size=3))
    running = index >= 40
    mode = messages.ControlMode(messages.Mode.LOCOMOTION, "rl_policy_controller", "START_LOCOMOTION accepted")
    fields = {
        "command": MITCommand(*rng.normal(size=(5, 3))),
        "control_mode": mode
        if running
        else messages.ControlMode(messages.Mode.STANDBY, "standby_controller_a", "LOAD_A accepted"),
        "standby": None if running else messages.StandbyState(index // 20, 2, index % 20 / 20, index == 39),
        "policy_step": messages.PolicyStep(index // 4, *np.split(rng.normal(size=7).astype(np.float32), [5]))
        if running and index % 4 == 0
        else None,
    }
    return messages.TickRecord(
        index=index,
        input=messages.TickInput(
            state, (messages.SafetyStatus(source="simulation"),), (messages.Intent.LOAD_A,) if index == 0 else ()
        ),
        output=messages.TickOutput(**fields | output),
        duration=1e-4,
        overrun=index % 50 == 7,
        qpos=rng.normal(size=3),
    )


def write_recording(path, ticks, header=None, events=()) -> None:
    """Record ticks, and events given as (time, text), through the recorder."""
    recorder = McapRecorder(path)
    recorder.start(make_header() if header is None else header)
    for record in ticks:
        recorder.tick(record)
    for time, text in events:
        recorder.event(messages.Event(time, text))
    recorder.close()
    assert recorder.error is None


any_float = st.binary(min_size=8, max_size=8).map(lambda data: struct.unpack("<d", data)[0])
"""Every bit pattern: NaNs with payloads, infinities, subnormals, both zeros."""

any_text = st.text(max_size=12)


def any_array(count: int, dtype=np.float64):
    size = count * np.dtype(dtype).itemsize
    return st.binary(min_size=size, max_size=size).map(lambda data: np.frombuffer(data, dtype))


def arrays(most: int, dtype=np.float64):
    return st.integers(0, most).flatmap(lambda count: any_array(count, dtype))


count, texts = st.integers(0, 2**32 - 1), st.lists(any_text, max_size=2).map(tuple)
flags = count.map(messages.SafetyFlag)
safety = st.builds(messages.SafetyStatus, st.sampled_from(messages.SafetyLevel), flags, any_text, any_text)
fault = st.builds(messages.FaultReport, any_text, any_text, any_text, st.booleans())
standby = st.builds(messages.StandbyState, count, count, any_float, st.booleans())
control_mode = st.builds(messages.ControlMode, st.sampled_from(messages.Mode), any_text, any_text)
floats32 = arrays(5, np.float32)
shapes = st.sampled_from([(2, 3), ()])
odd = shapes.flatmap(lambda shape: any_array(int(np.prod(shape)), np.float32).map(lambda action: action.reshape(shape)))
step = st.builds(messages.PolicyStep, st.integers(-(2**63), 2**63 - 1), floats32, floats32 | odd)
extern = st.dictionaries(any_text, st.builds(Extern, arrays(4), any_float, any_float), max_size=2)


@st.composite
def tick_records(draw, joints: int | None = None) -> messages.TickRecord:
    """Any record that one robot's tick can be."""
    n = draw(st.integers(1, 5)) if joints is None else joints
    command = st.builds(MITCommand, *[any_array(n)] * 5)
    state = st.builds(MITState, any_float, *map(any_array, (n, n, n, n, 4, 3, 3)), extern)
    statuses = st.lists(safety, max_size=3).map(tuple)
    intents = st.lists(st.sampled_from(messages.Intent), max_size=3).map(tuple)
    remote = st.none() | st.builds(messages.RemoteCommand, command, any_float)
    given = st.builds(messages.TickInput, state, statuses, intents, remote, any_text)
    faults = st.lists(fault, max_size=2).map(tuple)
    decided = control_mode, st.none() | standby, st.booleans(), faults, texts, st.none() | step, st.none() | any_text
    output = st.builds(messages.TickOutput, command, *decided)
    qpos = st.none() | arrays(4)
    index = st.integers(0, 2**64 - 1)
    return draw(st.builds(messages.TickRecord, index, given, output, any_float, st.booleans(), qpos))
