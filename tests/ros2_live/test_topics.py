"""Every topic of the bridge, with ROS 2 nodes of default settings on the robot's own computer."""

from xml.etree import ElementTree

import pytest
from machines import play, read_until
from strangers import COMMAND, JOINTS, TYPES, heard, listen, ticks_of, watch

pytestmark = pytest.mark.ros

TO_REMOTE = "damp; load_a; wait; start_remote; hold 300"


@pytest.fixture(scope="module")
def session(robot):
    """In REMOTE, with the bridge."""
    program = play(robot, "--dds", script=TO_REMOTE)
    read_until(program, "STANDBY → REMOTE")
    return program


@pytest.fixture(scope="module")
def listened(robot, messages, session):
    """What a late subscriber heard, and the feed meanwhile."""
    watching = watch(robot)
    told = heard(listen(robot, messages, 4.0, until=sorted(set(TYPES) - {"/standby_controller_b/state"})))
    return told, ticks_of(watching)


def test_each_topic_is_there_by_its_type_and_latched_ones_for_a_late_subscriber(listened):
    told, _ = listened
    there = {topic: kinds for topic, kinds in told["there"].items() if topic not in ("/rosout", "/parameter_events")}
    assert there == {
        topic: [kind] for topic, kind in {**TYPES, COMMAND: "humanoid_control_msgs/msg/MITCommand"}.items()
    }
    counts = told["counts"]
    once = ("/standby_controller_a/state", "/robot_description")
    assert {topic: counts[topic] for topic in once} == dict.fromkeys(once, 1)
    assert counts["/standby_controller_b/state"] == 0  # nobody was in that pose
    for topic in ("/lite/joint_states", "/imu/data", "/control_mode", "/tf"):
        assert counts[topic] >= 20, topic


def test_their_content_is_the_session_s(listened):
    told, fed = listened
    last = {topic: next(iter(of.values()), None) for topic, of in told["last"].items()}
    states = last["/lite/joint_states"]
    assert tuple(states["name"]) == JOINTS
    assert states["position"] in [tick["joint_position"] for tick in fed]
    assert last["/control_mode"]["mode"] == 4
    assert list(told["last"]["/safety_status"]) == ["mujoco"]
    assert last["/standby_controller_a/state"]["is_finished"] is True
    robot = ElementTree.fromstring(last["/robot_description"]["data"])
    assert {joint.get("name") for joint in robot.iter("joint") if joint.get("type") == "revolute"} >= set(JOINTS)
    links = {link.get("name") for link in robot.iter("link")}
    frames = {frame["child_frame_id"] for frame in last["/tf"]["transforms"]}
    assert frames == links - {"world"}
    assert last["/imu/data"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert last["/imu/data"]["header"]["frame_id"] == "imu"
    stamps = [last[topic]["header"]["stamp"] for topic in ("/lite/joint_states", "/imu/data")]
    seconds = [stamp["sec"] + 1e-9 * stamp["nanosec"] for stamp in stamps]
    assert max(seconds) - min(seconds) < 1.0
