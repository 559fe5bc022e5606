"""The policy's joints and the robot's are matched by name."""

from itertools import permutations

import numpy as np
import pytest
from control_run import CONTRACT, DAMPING, JOINTS, PATHS, POLICY_KD, POLICY_KP, RL, ZERO, Policy, Run, config
from control_surface import INPUT_ERRORS, supervisor

from humanoid_sim.mit import COMMAND_FIELDS


def by_joint(output, joints):
    sent = output.command
    return {name: [float(getattr(sent, field)[i]) for field in COMMAND_FIELDS] for i, name in enumerate(joints)}


def test_an_action_drives_the_joints_that_the_policy_names():
    policy = Policy(np.array([1.0, -1.0], np.float32))
    output = Run(policy=policy).reach(RL).step()
    expected = {"shoulder": 0.03 - 0.25, "elbow": 0.02 + 0.5, "wrist": 0.0}  # the wrist is not driven: at 0
    assert by_joint(output, JOINTS) == {
        name: [position, 0.0, 0.0, POLICY_KP[name], POLICY_KD[name]] for name, position in expected.items()
    }
    positions = np.array([0.6 - 0.01, 0.5 - 0.02, 0.4 - 0.03], np.float32)  # in the policy's order
    assert policy.seen[0].tolist() == [*positions.tolist(), *[0.0] * 11]
    assert policy.seen[0].dtype == np.float32


@pytest.mark.parametrize("controller", [name for name in PATHS if name not in (ZERO, DAMPING)])
@pytest.mark.parametrize("joints", list(permutations(JOINTS)), ids=" ".join)
def test_a_robot_with_another_order_gets_the_same_command_by_name(joints, controller):
    policies = [Policy(lambda seen: np.tanh(seen[:2])) for _ in range(2)]
    usual, permuted = Run(policy=policies[0]), Run(policy=policies[1], joints=joints)
    position = {"shoulder": 0.1, "elbow": -0.7, "wrist": 0.9}
    for run in (usual, permuted):
        run.reach(controller, position=position)
    for _ in range(4):
        outputs = [run.step(position=position) for run in (usual, permuted)]
        assert by_joint(outputs[0], JOINTS) == by_joint(outputs[1], joints)
    assert [seen.tolist() for seen in policies[0].seen] == [seen.tolist() for seen in policies[1].seen]


@pytest.mark.parametrize(
    ("names", "word"),
    [(("wrist", "elbow", "ankle"), "ankle"), (("wrist", "elbow", "shoulder", "neck"), "neck")],
)
def test_a_policy_for_another_robot_is_refused_with_the_joint(names, word):
    n = len(names)
    per_joint = {key: [1.0] * n for key in ("joint_stiffness", "joint_damping", "default_joint_pos")}
    contract = {**CONTRACT, "joint_names": names, "action_joint_names": ("elbow", "wrist"), **per_joint}
    with pytest.raises(INPUT_ERRORS, match=word):
        supervisor(config(contract=contract))
