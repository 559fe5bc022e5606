from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.errors import InputError
from humanoid_sim.mit import MITState
from humanoid_sim.play.hardware_robot import HardwareSetup
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model


def setup(name="lite", **options):
    config = PlayConfig(hardware="udp_multicast:239.74.163.9", **{"calibration": "none", **options})
    return HardwareSetup(config, load_robot(name), 0.02, ExitStack())


def test_a_policy_that_cannot_move_its_joints_is_refused():
    lite, robot = load_robot("lite"), setup()
    contract = load_checkpoint(SAMPLE_POLICY).contract
    robot.check_policy(contract)
    weak = replace(contract, joint_stiffness=np.zeros(lite.joint_count))
    with pytest.raises(InputError, match="joint_stiffness: is 0: the action cannot move"):
        robot.check_policy(weak)


@pytest.mark.parametrize("name", ["lite", "lite_biped"])
def test_joints_stand_where_they_were_measured_and_others_where_they_began(name):
    description = load_robot(name)
    model, robot = build_model(description, scene=False), setup(name)
    position = np.linspace(-0.3, 0.4, description.joint_count)
    position[2] = np.nan  # never heard
    qpos = robot.qpos(replace(MITState.unknown(description.joint_count), joint_position=position))
    assert not qpos.flags.writeable
    for i, joint in enumerate(description.joint_names):
        expected = description.initial_position[i] if i == 2 else position[i]
        assert qpos[model.joint(joint).qposadr[0]] == expected
    if description.is_floating:  # nobody measures where the base is
        assert qpos[:7].tolist() == model.qpos0[:7].tolist()
