"""What a bridge that comes later says of the Lite on a CAN bus, and keys that it takes from outside."""

import time
from dataclasses import replace
from itertools import count

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

import rig
from dds_bridge import bridge
from local_session import LocalSession, ticking
from stranger import Float32MultiArray, MultiArrayLayout, client, newest, until

from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.feed import MODEL_BLOB
from humanoid_sim.simulation.model import build_model, model_bytes
from humanoid_sim.stack import run_header
from humanoid_sim.testing import healthy_state


@pytest.fixture
def cyclone(domain):
    with client(domain) as joined:
        yield joined


def test_a_lite_on_a_bus_shows_its_body_under_the_lites_prefix(local, cyclone):
    neck = load_robot("lite_neck")
    blobs = {MODEL_BLOB: model_bytes(build_model(neck))}
    local.publish(run_header(neck, 0.02, None, settings={}), blobs, robot="lite_neck", hardware="can0")
    state = healthy_state([0.0] * 17, 3.5)
    output = TickOutput(MITCommand.zeros(17), ControlMode(Mode.DAMPING, "damping_controller", "Grüße"))
    with bridge():
        joint_states = cyclone.reader("rt/lite/joint_states")
        until(joint_states.get_matched_publications, "the joint states of all Lites")
        moving, clock = cyclone.reader("rt/tf"), cyclone.reader("rt/clock")
        mode, heard = cyclone.reader("rt/control_mode"), cyclone.reader("rt/imu/data")
        for reader in (moving, mode, heard):
            until(reader.get_matched_publications, f"the publication of {reader.topic.name}")
        index = count(1)

        def brought(reader):
            """By one of many ticks: what is sent with best effort may be lost."""

            def tick():
                i = next(index)
                later = replace(state, time=state.time + 0.1 * i)
                local.feed.tick(TickRecord(i, TickInput(later), output, 0.0, False))
                time.sleep(0.05)
                return reader.take(1000)[-1:]

            return until(tick, f"a sample of {reader.topic.name}")[0]

        assert brought(cyclone.reader("rt/robot_description")).data.startswith('<robot name="lite_neck"')
        fixed = brought(cyclone.reader("rt/tf_static")).transforms
        assert ("world", "chest") in [(one.header.frame_id, one.child_frame_id) for one in fixed]
        assert brought(joint_states).name == list(neck.joint_names)
        assert brought(mode).status_message == "Grüße"
        assert brought(heard).orientation.w == 1.0
        assert len(brought(moving).transforms) == 17
        assert clock.get_matched_publications() == [], "the clock of a real robot is the world's"


def test_keys_from_outside_reach_the_session_where_it_takes_them(domain, runtime):
    local = LocalSession(takes={"key_pressed": 3})
    with local.stack, client(domain) as cyclone, bridge(), ticking(local, rig.PERIOD) as records:
        reader = cyclone.reader("rt/piano/key_state")
        newest(cyclone.reader("rt/clock"))
        assert reader.get_matched_publications() == [], "never both"
        writer = cyclone.writer("rt/piano/key_state", depth=1)
        until(lambda: len(writer.get_matched_subscriptions()) == 2, "the bridge's subscriptions beside our own")
        keys = Float32MultiArray(MultiArrayLayout([], 0), [1.0, 0.0, 1.0])

        def pressed():
            state = records[-1].input.state
            return state.extern["key_pressed"].at(state.time).tolist() if "key_pressed" in state.extern else []

        def play():
            writer.write(keys)
            return pressed()

        until(lambda: play() == [1.0, 0.0, 1.0], "the keys")
        keys.data = [1.0] * 88
        writer.write(keys)
        until(lambda: pressed() == [0.0] * 3, "the timeout of what was not repeated")
