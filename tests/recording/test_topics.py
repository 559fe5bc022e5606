"""Topics for viewers: which live inputs and safety statuses they show, and when."""

import numpy as np
from recording_samples import make_header
from records import record_of

from humanoid_sim.assets import policy_path
from humanoid_sim.messages import FaultReport, Mode, SafetyStatus
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.readers.own import encode
from humanoid_sim.recording.topics import ViewerTopics
from humanoid_sim.ros2.messages import SESSION_FRAME, decode_safety_status
from humanoid_sim.ros2.topics import SAFETY_TOPIC
from humanoid_sim.testing.healthy import healthy_state

POLICY = "rl_policy_controller"


def said(topics, index, mode=Mode.DAMPING, *faults):
    """Safety statuses in the messages of a tick whose robot is well."""
    state = healthy_state(np.zeros(3), 0.005 * index)
    record = record_of(state, mode, "", SafetyStatus(source="can0"), index=index, faults=faults)
    found = [message.data for message in topics.messages(record, 0) if message.topic == SAFETY_TOPIC]
    decoded = [decode_safety_status(data) for data in found]
    assert {frame for frame, _ in decoded} <= {SESSION_FRAME}
    return [(status.source, status.level, status.message) for _, status in decoded]


def test_a_controller_that_fails_is_a_source_until_it_drives_again():
    topics = ViewerTopics(make_header())
    assert said(topics, 1) == [("can0", 0, "")]
    fault = FaultReport(POLICY, "damping_controller", "action is not finite")
    assert said(topics, 2, Mode.DAMPING, fault) == [(POLICY, 2, "action is not finite")]
    assert said(topics, 3) == []
    assert said(topics, 201, Mode.LOCOMOTION) == [(POLICY, 0, "")]
    assert said(topics, 202, Mode.LOCOMOTION) == []


def test_live_inputs_from_outside_have_topics_and_what_the_robot_measures_has_none():
    contract = encode(load_checkpoint(policy_path("lite_biped_velocity")).contract)
    header = make_header(documents={**make_header().documents, "contract": contract})
    assert set(ViewerTopics(header).live) == {"key_pressed", "height_scan"}
