from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.errors import InputError
from humanoid_sim.mit import MITState
from humanoid_sim.play.hardware_robot import MeasuredPose, check_policy, real_robot
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model


def test_a_policy_that_cannot_move_its_joints_is_refused():
    lite = load_robot("lite")
    contract = load_checkpoint(SAMPLE_POLICY).contract
    check_policy(contract, lite, has_imu=True)
    weak = replace(contract, joint_stiffness=np.zeros(lite.joint_count))
    with pytest.raises(InputError, match="joint_stiffness: is 0: the action cannot move"):
        check_policy(weak, lite, has_imu=True)


@pytest.mark.parametrize("name", ["lite", "lite_biped"])
def test_joints_stand_where_they_were_measured_and_others_where_they_began(name):
    description = load_robot(name)
    model, pose = build_model(description, scene=False), MeasuredPose(description)
    position = np.linspace(-0.3, 0.4, description.joint_count)
    position[2] = np.nan  # never heard
    state = replace(MITState.unknown(description.joint_count), joint_position=position)
    qpos = pose(state)
    assert qpos.shape == (model.nq,)
    assert not qpos.flags.writeable
    for i, joint in enumerate(description.joint_names):
        expected = description.initial_position[i] if i == 2 else position[i]
        assert qpos[model.joint(joint).qposadr[0]] == expected
    if description.is_floating:  # nobody measures where the base is
        assert qpos[:7].tolist() == model.qpos0[:7].tolist()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"can_timeout": 0.01}, "CAN timeout: is 0.01 s, expected more than the control period of 0.02 s, and at most"),
        ({"can_timeout": 6.0}, "CAN timeout: is 6 s, expected more than the control period"),
        ({"accept_firmware": ("new",)}, "firmware version: is 'new', expected four numbers of 0 to 255 such as 0."),
    ],
)
def test_options_for_the_motors_reach_the_adapter(options, message):
    config = PlayConfig(hardware="udp_multicast:239.74.163.9", calibration="none", **options)
    with pytest.raises(InputError) as refused:
        real_robot(config, load_robot("lite"), 0.02, ExitStack())
    assert str(refused.value).startswith(message)


@pytest.mark.parametrize(
    ("channel", "end"),
    [
        ("can0", r"humanoid_sim\.hardware calibrate"),
        (
            "udp_multicast:239.74.163.9",
            r"humanoid_sim\.hardware calibrate, or add --calibration none for motors of hardware emulate",
        ),
    ],
)
def test_where_motors_may_be_emulated_it_says_how_to_do_without_a_calibration(channel, end, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=rf"^--calibration: is missing, .*{end}$"):
        real_robot(PlayConfig(hardware=channel), load_robot("lite"), 0.02, ExitStack())
