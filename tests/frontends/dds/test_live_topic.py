"""A policy with a sensor of its own: fed by a topic that its contract names, from DDS and from a Python program."""

import json
import threading
import time
from contextlib import contextmanager

import onnx
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

from cyclonedds.core import Policy, Qos
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from dds_bridge import bridge
from fates import playing, until
from models import linear_model
from play_fixtures import quick_robot
from stranger import Float32MultiArray, MultiArrayLayout, client, newest

from humanoid_sim.client import Intake
from humanoid_sim.messages import Mode
from humanoid_sim.robots.description import load_robot

pytestmark = pytest.mark.soak

SENSOR = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(5))
"""ROS 2's quality of service for sensors."""
LATCHED = Qos(Policy.Reliability.Reliable(100_000_000), Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
CONTRACT = """
joint_names: {joints}
observation: [joint_pos, {{name: contact, kind: foot_contact, width: 2, topic: {topic}, timeout: {timeout}}}]
default_joint_pos: {pose}
joint_stiffness: 50
joint_damping: 2
action_scale: 0.01
policy_dt: 0.02
"""


def sensing(folder, topic, timeout):
    """Options of `play` for a Lite whose policy observes two values of a sensor."""
    lite = load_robot("lite")
    onnx.save(linear_model({}, inputs=lite.joint_count + 2, outputs=lite.joint_count), str(folder / "foot.onnx"))
    pose = list(lite.standby_controller_a.pose_segments[-1])
    text = CONTRACT.format(joints=json.dumps(lite.joint_names), pose=pose, topic=topic, timeout=timeout)
    (folder / "contract.yaml").write_text(text, encoding="utf-8")
    return ("--robot", quick_robot(folder), "--policy", str(folder / "foot.onnx"))


def message(*values):
    return Float32MultiArray(MultiArrayLayout([], 0), list(values))


def writer(at, topic, quality):
    return DataWriter(at.participant, Topic(at.participant, f"rt{topic}", Float32MultiArray), quality)


def now(play):
    """The latest tick; a sample that is being overwritten is none."""
    return play.feed.decode(until(play.feed.latest))


def stand_by(play):
    for word in ("damp", "load_a"):
        assert play.operator.ask(word).granted, word
    until(lambda: [standby for standby in now(play)["standby"] if standby["is_finished"]])


def start(play):
    return play.operator.ask("start_locomotion").text


@contextmanager
def repeated(sensor, *values):
    """A publisher that repeats its values 50 times a second."""
    stop = threading.Event()

    def publish():
        while not stop.wait(0.02):
            sensor.write(message(*values))

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_a_topic_of_its_own_feeds_the_policy_while_it_is_fresh(folder):
    options = sensing(folder, "/feet/contact", "1.0")
    options += ("--script", "hold 600", "--dds")
    with playing(folder, *options) as play, client(play.domain) as ros:
        told = newest(ros.reader("rt/clock")).clock
        behind = time.time() - told.sec - 1e-9 * told.nanosec
        assert -0.5 < behind < 2.0, "the clock begins with the loop, not before the bridge was waited for"
        begun = play.feed.status()["start_time_ns"]
        stand_by(play)
        refusal = "START_LOCOMOTION refused: the live input 'foot_contact' (/feet/contact) has not come yet"
        assert refusal in start(play)
        sensor = writer(ros, "/feet/contact", SENSOR)
        until(sensor.get_matched_subscriptions)
        told = "/feet/contact: has 3 values, expected 2 for the live input 'foot_contact'"

        def wrong():
            sensor.write(message(1.0, 0.0, 1.0))
            return told in play.feed.status().get("refused_last", "")

        until(wrong)
        assert refusal in start(play)
        with repeated(sensor, 0.25, 1.0):
            until(lambda: play.operator.ask("start_locomotion").granted)
            time.sleep(0.6)
            assert play.mode() is Mode.LOCOMOTION
        until(lambda: play.mode() is Mode.DAMPING)
        stand_by(play)
        assert "START_LOCOMOTION refused: the live input 'foot_contact' (/feet/contact) is " in start(play)
        assert "s old, expected at most 1 s" in start(play)
        for word in ("damp", "quit"):
            play.operator.ask(word)
        log = play.finish()
    assert log.status == 1, play.said
    (fault,) = [tick for tick in log.ticks if tick.output.faults]
    stale = "is nan, expected a finite number: no value has come, or the last one is too old"
    assert fault.output.faults[0].message == f"observation contact[0] {stale}"
    last = fault.input.state.extern["foot_contact"]
    assert (last.value.tolist(), last.timeout) == ([0.25, 1.0], 1.0)
    assert 1.0 < float(fault.input.state.time) - last.arrival_time < 1.05, "found in the policy's next step"
    assert [mode for mode, _ in log.course if mode is Mode.LOCOMOTION] == [Mode.LOCOMOTION]
    steps = [tick.output.policy_step for tick in log.ticks if tick.output.policy_step is not None]
    assert len(steps) > 20
    assert {tuple(step.observation[-2:].tolist()) for step in steps} == {(0.25, 1.0)}
    assert log.is_exact(), "the recording holds what came"
    assert log.recording.header.start_time_ns == begun, "one clock for topics and recording"


def test_one_that_never_gets_stale_is_sent_once_before_the_bridge_is_there(folder, monkeypatch):
    """On emulated motors, with a timeout of infinity, for publishers that publish on change."""
    options = sensing(folder, "/feet/contact", ".inf")
    hardware = ("--hardware", f"virtual:{folder.name}", "--yes")
    with playing(folder, *options, *hardware) as play, client(play.domain) as ros:
        assert "which a program has to send" in play.said
        sensor = writer(ros, "/feet/contact", LATCHED)
        sensor.write(message(0.0, 1.0))
        monkeypatch.setenv("ROS_DOMAIN_ID", str(play.domain))
        with bridge():
            until(lambda: play.feed.status().get("owners", {}).get("foot_contact"))
            stand_by(play)
            until(lambda: play.operator.ask("start_locomotion").granted)
            time.sleep(1.0)
            assert play.mode() is Mode.LOCOMOTION
        until(lambda: not play.feed.status()["owners"]["foot_contact"])
        with Intake(play.feed.session, "python") as intake:  # its first producer is silent: another may go on
            intake.live("foot_contact", [1.0, 1.0])
            until(lambda: [one["value"].tolist() for one in now(play)["extern"]] == [[1.0, 1.0]])
            intake.live("foot_contact", [1.0, 1.0], timeout=0.1)
            until(lambda: play.mode() is Mode.DAMPING)
        play.operator.ask("quit")
        log = play.finish()
    assert {tick.input.state.extern["foot_contact"].timeout for tick in log.ticks[-1:]} == {0.1}
    assert log.is_exact()
