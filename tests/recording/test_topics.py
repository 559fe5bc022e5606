"""Topics for viewers: which live inputs and safety statuses they show, and when."""

from dataclasses import replace

from recording_samples import make_header, make_tick

from humanoid_sim.assets import policy_path
from humanoid_sim.messages import ControlMode, FaultReport, Mode, SafetyStatus
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.readers.own import encode
from humanoid_sim.recording.topics import ViewerTopics
from humanoid_sim.ros2.messages import SESSION_FRAME, decode_safety_status
from humanoid_sim.ros2.topics import SAFETY_TOPIC

WELL = (SafetyStatus(source="can0"),)
POLICY = "rl_policy_controller"
DAMPED = ControlMode(Mode.DAMPING, "damping_controller")


def tick(index, *, mode=DAMPED, faults=()):
    record = make_tick(index)
    output = replace(record.output, control_mode=mode, faults=faults)
    return replace(record, input=replace(record.input, safety=WELL), output=output)


def said(topics, record):
    found = [message.data for message in topics.messages(record, 0) if message.topic == SAFETY_TOPIC]
    frames, statuses = zip(*map(decode_safety_status, found), strict=True) if found else ((), ())
    assert {*frames} <= {SESSION_FRAME}
    return [(status.source, status.level, status.message) for status in statuses]


def test_a_controller_that_fails_is_a_source_until_it_drives_again():
    topics = ViewerTopics(make_header())
    assert said(topics, tick(1)) == [("can0", 0, "")]
    fault = FaultReport(POLICY, "damping_controller", "action is not finite")
    assert said(topics, tick(2, faults=(fault,))) == [(POLICY, 2, "action is not finite")]
    assert said(topics, tick(3)) == []
    driving = ControlMode(Mode.LOCOMOTION, POLICY)
    assert said(topics, tick(201, mode=driving)) == [(POLICY, 0, "")]
    assert said(topics, tick(202, mode=driving)) == []


def test_live_inputs_from_outside_have_topics_and_what_the_robot_measures_has_none():
    contract = encode(load_checkpoint(policy_path("lite_biped_velocity")).contract)
    header = make_header(documents={**make_header().documents, "contract": contract})
    assert set(ViewerTopics(header).live) == {"key_pressed", "height_scan"}
