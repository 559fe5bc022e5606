import time
from dataclasses import replace

import numpy as np
import pytest
from dds_bridge import program

from humanoid_sim.gravity import gravity_command
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


@pytest.mark.soak
def test_as_a_program_it_answers_each_tick_and_ends_with_the_session(session, pose):
    with program("gravity", says="gravity compensation (effort) for session ") as (process, _):
        output = TickOutput(MITCommand.zeros(len(pose)), ControlMode(Mode.REMOTE, "remote_policy_controller"))
        state = replace(MITState.unknown(len(pose), 0.0), joint_position=pose)
        deadline = time.monotonic() + 30.0
        index = 0
        while session.data.remote is None:
            assert time.monotonic() < deadline
            index += 1
            session.feed.tick(TickRecord(index, TickInput(state), output, 0.0, False))
            time.sleep(0.005)
            session.data.latest()
        latest = session.data.remote
        assert latest.command.position.tolist() == pose.tolist()
        assert np.abs(latest.command.effort).max() > 1.0
        session.registration.close()
        assert process.wait(60.0) == 0
