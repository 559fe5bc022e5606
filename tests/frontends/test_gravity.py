import time
from dataclasses import replace

import numpy as np
import pytest
from dds_bridge import program

from humanoid_sim.gravity import GravityProducer, gravity_command
from humanoid_sim.messages import ControlMode, Mode, SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState, mit_torque
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.feed import MODEL_BLOB
from humanoid_sim.simulation.kinematics import GravityTorque
from humanoid_sim.simulation.model import build_model, model_bytes


@pytest.fixture(scope="module")
def lite():
    return load_robot("lite")


@pytest.fixture(scope="module")
def pose(lite):
    return np.array(lite.standby_controller_a.pose_segments[-1])


@pytest.fixture
def session(local, lite):
    """A session of the Lite, whose description names an MJCF that is not there: its own model must do."""
    document = lite.to_json().replace("../mjcf/lite.xml", "nowhere.xml")
    assert "nowhere" in document
    header = SessionHeader("lite", lite.joint_names, 0.005, 0, {"robot": document})
    local.publish(header, {MODEL_BLOB: model_bytes(build_model(lite))}, robot="lite")
    local.data._joints = lite.joint_names
    return local


def record(position, *, remote, time=0.0):
    name, mode = ("remote_policy_controller", Mode.REMOTE) if remote else ("damping_controller", Mode.DAMPING)
    output = TickOutput(MITCommand.zeros(len(position)), ControlMode(mode, name))
    state = replace(MITState.unknown(len(position), time), joint_position=position)
    return TickRecord(0, TickInput(state), output, 0.0, False)


@pytest.mark.parametrize("form", ["effort", "pd"])
def test_both_forms_hold_the_pose_at_rest(lite, pose, form):
    gravity = GravityTorque(lite)(pose)
    assert np.abs(gravity).max() > 1.0  # there is something to hold
    command = gravity_command(lite, pose, gravity, form)
    torque = mit_torque(command, pose, np.zeros(len(pose)), lite.effort_limit)
    np.testing.assert_allclose(torque, gravity, atol=1e-12)
    assert not command.velocity.any()
    assert bool(command.stiffness.any()) == (form == "pd")
    assert bool(command.effort.any()) == (form == "effort")
    assert (command.damping > 0.0).all()


def test_the_effort_form_compensates_whatever_pose_the_arms_are_in(lite, pose):
    producer, gravity = GravityProducer(lite, build_model(lite), "effort"), GravityTorque(lite)
    for position in (pose, 0.5 * pose):
        command = producer.command(record(position, remote=True))
        assert command.position.tolist() == position.tolist()
        np.testing.assert_allclose(command.effort, gravity(position), atol=1e-12)


def test_the_pd_form_holds_the_first_pose_of_each_stay_in_remote(lite, pose):
    producer, gravity = GravityProducer(lite, build_model(lite), "pd"), GravityTorque(lite)
    for tick, held in (
        (record(0.9 * pose, remote=False), 0.9 * pose),
        (record(pose, remote=True), pose),
        (record(0.8 * pose, remote=True), pose),  # pushed away: it pulls back
        (record(0.7 * pose, remote=False), 0.7 * pose),
        (record(0.6 * pose, remote=True), 0.6 * pose),
    ):
        command = producer.command(tick)
        np.testing.assert_allclose(command.position, held + gravity(held) / lite.stiffness, atol=1e-12)


def test_a_state_that_is_not_known_sends_nothing(lite, pose):
    unknown = pose.copy()
    unknown[3] = np.nan
    assert GravityProducer(lite, build_model(lite), "effort").command(record(unknown, remote=True)) is None


@pytest.mark.soak
def test_as_a_program_it_answers_each_tick_and_ends_with_the_session(session, pose):
    with program("gravity", says="gravity compensation (effort) for session ") as (process, _):
        deadline = time.monotonic() + 30.0
        index = 0
        while session.data.remote is None:
            assert time.monotonic() < deadline
            index += 1
            session.feed.tick(replace(record(pose, remote=True), index=index))
            time.sleep(0.005)
            session.data.latest()
        latest = session.data.remote
        assert latest.command.position.tolist() == pose.tolist()
        assert np.abs(latest.command.effort).max() > 1.0
        session.registration.close()
        assert process.wait(60.0) == 0
