"""Two robots with the same topics in one domain, each under a namespace of its own; the bridge of one dies."""

import os
import signal
import time

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

import fates
from fates import playing, until
from play_fixtures import quick_robot

from humanoid_sim.dds_client import RobotClient
from humanoid_sim.messages import Mode, SafetyStatus
from humanoid_sim.mit import MITCommand
from humanoid_sim.ros2.dds.endpoints import Reader, Writer
from humanoid_sim.ros2.definitions import JOINT_STATE
from humanoid_sim.ros2.messages import SESSION_FRAME, encode_mit_command, encode_safety_status
from humanoid_sim.ros2.topics import COMMAND_TOPIC, SAFETY_TOPIC, TOPICS, Topic

JOINTS = {"/lite/joint_states": Topic(JOINT_STATE)}


def test_neither_of_two_hears_the_other_and_a_dead_bridge_is_started_again(domain, runtime, monkeypatch):
    monkeypatch.setattr(fates, "free_domain", lambda: domain)
    folders = [runtime / name for name in ("left", "right")]
    for folder in folders:
        folder.mkdir()
    options = ("--script", "damp; load_a; wait; start_remote; hold 600", "--dds", "--dds-namespace")
    left, right = (playing(one, *options, one.name, "--robot", quick_robot(one)) for one in folders)
    with left as one, right as other, RobotClient("lite", namespace="left") as client:
        assert one.reach(Mode.REMOTE)
        assert other.reach(Mode.REMOTE)
        state = until(lambda: client.state(0.1))
        zeros, ones = np.zeros(len(state.names)), np.ones(len(state.names))
        command = MITCommand(state.position, zeros, zeros, 5.0 * ones, ones)
        until(lambda: client.command(command) and one.feed.status().get("owners", {}).get("REMOTE"))
        assert not other.feed.status()["owners"]["REMOTE"]
        joined = client._participant
        joined.namespace = ""  # as a stranger sees the domain
        kinds = {name: kind for name, kind in {**TOPICS, **JOINTS}.items() if name != COMMAND_TOPIC}
        there = {name: Reader(joined, name, kind) for name, kind in kinds.items()}
        under = {name: Reader(joined, f"/right{name}", kind) for name, kind in kinds.items()}
        until(lambda: all(reader.writers == 1 for reader in under.values()))
        assert [name for name, reader in there.items() if reader.writers] == [], "nothing is outside the namespaces"
        fault = encode_safety_status(0, SafetyStatus(2, 0, "fence", "open")).replace(
            SESSION_FRAME.encode(), b"another_one!"
        )
        strangers = {name: Writer(joined, name, TOPICS[name]) for name in (COMMAND_TOPIC, SAFETY_TOPIC)}
        damper = Writer(joined, f"/right{SAFETY_TOPIC}", TOPICS[SAFETY_TOPIC])
        time.sleep(0.5)
        strangers[SAFETY_TOPIC].write(fault)
        strangers[COMMAND_TOPIC].write(encode_mit_command(0, state.names, command))
        assert [writer.readers for writer in strangers.values()] == [0, 1], "our own reader alone"
        damper.write(fault)
        assert other.reach(Mode.DAMPING)
        assert one.mode() is Mode.REMOTE

        def shown():
            return float(one.feed.decode(until(one.feed.latest))["command_stiffness"].max())

        until(lambda: client.command(command) and shown() == 5.0)
        before = one.feed.status()["front_ends"]["dds"]
        os.kill(before, signal.SIGKILL)
        until(lambda: shown() == 0.0)
        until(lambda: one.feed.status()["front_ends"].get("dds", before) != before)
        topic = Reader(joined, "/left/lite/joint_states", JOINTS["/lite/joint_states"])
        until(topic.take)
        assert not one.feed.status()["owners"]["REMOTE"], "its bridge was restarted, and what came before is nothing"
        assert shown() == 0.0
        until(lambda: client.command(command) and shown() == 5.0)

        def streamed(is_so):
            client.command(command)
            return is_so()

        before = one.feed.status()["front_ends"]["dds"]
        os.kill(before, signal.SIGKILL)
        until(lambda: streamed(lambda: shown() == 0.0))
        until(lambda: streamed(lambda: shown() == 5.0))
        assert one.feed.status()["front_ends"]["dds"] != before, "the new bridge, to which nobody sent a START_REMOTE"
        assert one.mode() is Mode.REMOTE
        for word in ("damp", "quit"):
            one.operator.ask(word)
        log = one.finish()
    told = [event.text for event in log.events if event.text.startswith("front end dds")]
    ended = "front end dds ended with status -9"
    assert told == [text for time in (1, 2) for text in (ended, f"front end dds was started again, {time} of 3 times")]
