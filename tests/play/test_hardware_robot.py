from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.mit import MITState
from humanoid_sim.play.hardware_robot import MeasuredPose
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model


@pytest.mark.parametrize("name", ["lite", "lite_biped"])
def test_joints_stand_where_they_were_measured_and_others_where_they_began(name: str) -> None:
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
