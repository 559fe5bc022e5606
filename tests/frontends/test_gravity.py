import numpy as np
import pytest

from humanoid_sim.gravity import gravity_command
from humanoid_sim.mit import mit_torque
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import GravityTorque


@pytest.mark.parametrize("form", ["effort", "pd"])
def test_both_forms_hold_the_pose_at_rest(form):
    lite = load_robot("lite")
    pose = np.array(lite.standby_controller_a.pose_segments[-1])
    gravity = GravityTorque(lite)(pose)
    assert np.abs(gravity).max() > 1.0  # there is something to hold
    command = gravity_command(lite, pose, gravity, form)
    torque = mit_torque(command, pose, np.zeros(len(pose)), lite.effort_limit)
    np.testing.assert_allclose(torque, gravity, atol=1e-12)
    assert not command.velocity.any()
    assert (command.stiffness.any(), command.effort.any()) == (form == "pd", form == "effort")
    assert (command.damping > 0.0).all()
