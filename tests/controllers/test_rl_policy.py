"""LOCOMOTION: the policy's view, its rate and its motion; `tests/survive` has its failures."""

import numpy as np
import pytest
from rig import JOINTS, PERIOD, contract, good_answer, reference, tick

from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.errors import FieldError
from humanoid_sim.testing.healthy import ScriptedPolicy
from humanoid_sim.testing.properties import fingerprint


def zeros(observation, frame):
    return np.zeros(2)


def controller(policy=zeros, **changes):
    values = {
        "joints": JOINTS,
        "contract": contract(),
        "reference": reference(),
        "control_period": PERIOD,
        "extern": {"velocity_command": 3},
    }
    return RLPolicyController(**{**values, "policy": policy, **changes})


def run(rl, count):
    """Memory and command of each tick."""
    memory = rl.activate(tick())
    results = []
    for i in range(count):
        memory, command = rl.update(memory, tick(i * PERIOD))
        results.append((memory, command))
    return results


@pytest.mark.parametrize(("period", "decimation"), [(0.04, 1), (0.005, 8), (0.04 / 3, 3), (0.04 * (1 + 1e-9), 1)])
def test_one_inference_every_policy_dt_and_the_command_held_between(period, decimation):
    policy = ScriptedPolicy(good_answer)
    rl = controller(policy, control_period=period)
    assert rl.decimation == decimation
    results = run(rl, 3 * decimation)
    assert len(policy.calls) == 3
    for i, (memory, command) in enumerate(results):
        assert (memory.policy_step is not None) == (i % decimation == 0)
        assert command is results[i - i % decimation][1]
    assert len({fingerprint(results[i * decimation][1]) for i in range(3)}) == 3


def test_the_frame_advances_once_per_inference_and_each_activation_begins_anew():
    policy = ScriptedPolicy(zeros)
    results = run(controller(policy), 10)
    frames = [0, 1, 2, 3, 3]
    assert [frame for _, frame in policy.calls] == frames
    assert [memory.policy_step.frame for memory, _ in results if memory.policy_step] == frames
    assert [observation[:3].tolist() for observation, _ in policy.calls] == [[f, f + 0.25, f + 0.5] for f in frames]
    assert [float(o[11]) for o, _ in policy.calls] == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0, 1.0]), "progress"
    run(controller(policy), 1)
    assert policy.calls[-1][1] == 0


@pytest.mark.parametrize("period", [0.03, 0.08])
def test_a_rate_that_is_no_whole_multiple_of_the_policys_is_refused(period):
    with pytest.raises(FieldError, match=rf"\.control_period: is {period} s, expected policy_dt \(0\.04 s\)"):
        controller(control_period=period)
