import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from humanoid_sim.errors import InputError
from humanoid_sim.messages import PolicyStep, SessionHeader
from humanoid_sim.mit import MITCommand
from humanoid_sim.recording import shadow
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.recording.topics import TopicMessage
from humanoid_sim.ros2.cdr import CdrError, CdrWriter
from humanoid_sim.ros2.definitions import SHADOW_STEP, schema_text

SEEN = PolicyStep(4, np.array([0.1, 0.2, 0.3], dtype=np.float32), np.array([1.5, -2.5], dtype=np.float32))
COMMAND = MITCommand(*(np.array([0.1 * k, 0.2, 0.3]) for k in range(5)))
STEP = shadow.ShadowStep(17, 0.34, SEEN, COMMAND)
FAULT = shadow.ShadowStep(
    18, 0.36, PolicyStep(5, SEEN.observation, np.full(2, np.nan, dtype=np.float32)), None, "is NaN"
)


def values(step):
    seen = None if step.step is None else (step.step.frame, step.step.observation.tolist(), str(step.step.action))
    command = step.command and [getattr(step.command, name).tolist() for name in ("position", "stiffness", "damping")]
    return step.tick, step.time, seen, command, step.fault


@pytest.mark.parametrize("step", [STEP, FAULT, shadow.ShadowStep(0, 0.0, fault="a joint was never heard")])
def test_a_step_comes_back_as_it_was(step):
    assert values(shadow.decode_shadow_step(shadow.encode_shadow_step(step))) == values(step)


def test_ros_2_reads_it():
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(SHADOW_STEP), SHADOW_STEP))
    read = store.deserialize_cdr(shadow.encode_shadow_step(STEP), SHADOW_STEP)
    assert (read.tick, read.time, read.frame, read.fault) == (17, 0.34, 4, "")
    assert read.action.tolist() == [1.5, -2.5]
    assert read.command_stiffness.tolist() == pytest.approx([0.3, 0.2, 0.3])


def test_an_answer_that_is_much_too_long_is_cut():
    long = PolicyStep(0, SEEN.observation, np.zeros((1000, 1000), dtype=np.float32))
    step = shadow.decode_shadow_step(shadow.encode_shadow_step(shadow.ShadowStep(0, 0.0, long, fault="too long"))).step
    assert step.action.shape == (4096,)


def recorded(path, *messages):
    recorder = McapRecorder(path)
    recorder.start(SessionHeader("three", ("a", "b", "c"), 0.02, 0))
    for message in messages:
        recorder.beside(0.5, (TopicMessage(shadow.SHADOW_TOPIC, SHADOW_STEP, message),))
    recorder.close()
    assert recorder.error is None
    return path


def test_the_steps_of_a_recording(tmp_path):
    path = recorded(tmp_path / "r.mcap", *map(shadow.encode_shadow_step, (STEP, FAULT)))
    assert [values(step) for step in shadow.read_shadow_steps(path)] == [values(STEP), values(FAULT)]
    assert list(shadow.read_shadow_steps(recorded(tmp_path / "none.mcap"))) == []


def test_a_damaged_step_is_refused(tmp_path):
    writer = CdrWriter()
    writer.pack("Qdq", 17, 0.34, 4)
    for values_of in (SEEN.observation, SEEN.action, *(np.zeros(count) for count in (3, 3, 2, 3, 3))):
        writer.array(values_of)
    writer.string("")
    with pytest.raises(CdrError, match=r"^a command whose arrays differ in length$"):
        shadow.decode_shadow_step(writer.message())
    path = recorded(tmp_path / "r.mcap", shadow.encode_shadow_step(STEP)[:40])
    with pytest.raises(InputError, match=r"r\.mcap: a message of /humanoid_sim/shadow/step: "):
        list(shadow.read_shadow_steps(path))
