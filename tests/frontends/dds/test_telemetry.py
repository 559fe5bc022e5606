"""Which topics are served, and keys that are taken from outside."""

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

import rig
from dds_bridge import bridge
from local_session import LocalSession, ticking
from stranger import Float32MultiArray, MultiArrayLayout, client, newest, until

from humanoid_sim.frontends.dds.telemetry import served_topics
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import run_header


def test_safety_and_standby_stay_on_the_machine():
    header = run_header(load_robot("lite_neck"), 0.02, None, settings={})
    across = {"/lite/joint_states", "/imu/data", "/control_mode", "/robot_description", "/tf"}
    assert served_topics(header, is_local=False) == across, "the prefix of all Lites"
    own = {"/standby_controller_a/state", "/standby_controller_b/state", "/safety_status"}
    assert served_topics(header, is_local=True) == across | own


def test_keys_from_outside_reach_the_session_where_it_takes_them(domain, runtime):
    local = LocalSession(takes={"key_pressed": 3})
    with local.stack, client(domain) as cyclone, bridge(), ticking(local, rig.PERIOD) as records:
        reader = cyclone.reader("rt/piano/key_state")
        newest(cyclone.reader("rt/control_mode"))
        assert reader.get_matched_publications() == [], "never both"
        writer = cyclone.writer("rt/piano/key_state", depth=1)
        until(lambda: len(writer.get_matched_subscriptions()) == 2, "the bridge's subscription beside our own")
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
