"""LOCOMOTION: the policy's view, its rate, its motion and its failures."""

import re
from dataclasses import replace

import numpy as np
import pytest
from rig import JOINTS, PERIOD, contract, good_answer, reference, tick

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.reference import MotionReference, no_reference
from humanoid_sim.controllers.rl_policy import RLPolicyController, ticks_per_step
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import Extern
from humanoid_sim.testing import ScriptedPolicy, fingerprint

NAN, INF = np.nan, np.inf


def zeros(observation, frame):
    return np.zeros(2)


def controller(policy=zeros, **changes):
    values = {
        "joints": JOINTS,
        "contract": contract(),
        "reference": reference(),
        "control_period": PERIOD,
        "extern": {"velocity": 3},
    }
    return RLPolicyController(**{**values, "policy": policy, **changes})


def run(rl, count, start=0.0, **inputs):
    """Memory and command of each tick; a fault ends the run."""
    memory = rl.activate(tick(start, **inputs))
    results = []
    for i in range(count):
        result = rl.update(memory, tick(start + i * PERIOD, **inputs))
        results.append(result)
        if isinstance(result, Fault):
            break
        memory, _ = result
    return results


def test_the_policy_sees_its_own_joint_order():
    policy = ScriptedPolicy(zeros)
    memory = controller(policy).activate(tick())
    state = tick(0.0, position=(0.4, 0.5, 0.6), extern={"velocity": Extern([7.0, 8.0, 9.0], 0.0)}).state
    moving = replace(state, joint_velocity=[1.0, 2.0, 3.0])
    controller(policy).update(memory, replace(tick(), state=moving))
    ((observation, frame),) = policy.calls
    assert frame == 0
    assert observation.dtype == np.float32
    expected = [0.0, 0.25, 0.5, 0.59, 0.48, 0.37, 3.0, 2.0, 1.0, 0.0, 0.0, 0.0, 7.0, 8.0, 9.0]
    assert observation.tolist() == np.array(expected, dtype=np.float32).tolist()


def test_the_action_drives_its_own_joints():
    rl = controller(lambda *_: [2.0, -4.0])  # of elbow and shoulder
    ((_, command),) = run(rl, 1)
    assert command.position.tolist() == pytest.approx([0.03 + 0.25 * -4.0, 0.02 + 0.5 * 2.0, 0.0])
    assert command.stiffness.tolist() == [33.0, 32.0, 31.0]
    assert command.damping.tolist() == [3.3, 3.2, 3.1]
    assert command.velocity.tolist() == command.effort.tolist() == [0.0, 0.0, 0.0]


def test_the_last_action_is_seen_raw_one_step_later():
    answers = iter([[1.5, -2.5], [3.5, 4.5], [0.0, 0.0]])
    policy = ScriptedPolicy(lambda *_: next(answers))
    run(controller(policy), 6)
    assert [observation[9:11].tolist() for observation, _ in policy.calls] == [[0.0, 0.0], [1.5, -2.5], [3.5, 4.5]]


@pytest.mark.parametrize(("period", "decimation"), [(0.04, 1), (0.02, 2), (0.01, 4), (0.005, 8), (0.04 / 3, 3)])
def test_one_inference_every_policy_dt_and_the_command_held_between(period, decimation):
    policy = ScriptedPolicy(good_answer)
    rl = controller(policy, control_period=period)
    assert rl.decimation == decimation
    results = run(rl, 3 * decimation)
    assert len(policy.calls) == 3
    for i, (memory, command) in enumerate(results):
        assert (memory.policy_step is not None) == (i % decimation == 0)
        assert fingerprint(command) == fingerprint(results[i - i % decimation][1])
        if decimation > 1 and memory.policy_step is not None:
            _, held = rl.update(memory, tick((i + 1) * period, position=(2.0, 2.0, 2.0)))
            assert fingerprint(held) == fingerprint(command), "whatever the state is meanwhile"
    steps = [fingerprint(results[i * decimation][1]) for i in range(3)]
    assert len(set(steps)) == 3


def test_the_frame_advances_once_per_inference_and_holds_at_the_end():
    policy = ScriptedPolicy(zeros)
    results = run(controller(policy), 14)
    assert [frame for _, frame in policy.calls] == [0, 1, 2, 3, 3, 3, 3]
    assert [observation[:3].tolist() for observation, _ in policy.calls] == [
        [frame, frame + 0.25, frame + 0.5] for frame in (0, 1, 2, 3, 3, 3, 3)
    ]
    progress = [float(observation[11]) for observation, _ in policy.calls]
    assert progress == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0, 1.0, 1.0, 1.0])
    steps = [memory.policy_step for memory, _ in results if memory.policy_step]
    assert [step.frame for step in steps] == [0, 1, 2, 3, 3, 3, 3]


def test_activation_starts_the_motion_anew():
    policy = ScriptedPolicy(lambda *_: [1.0, 1.0])
    rl = controller(policy)
    run(rl, 6)
    run(rl, 2)
    assert [frame for _, frame in policy.calls] == [0, 1, 2, 0]
    assert policy.calls[-1][0][9:11].tolist() == [0.0, 0.0]


def test_a_policy_without_a_motion_and_with_one_of_one_frame():
    plain = contract(task_type="locomotion", observation=("joint_pos",), body_names=())
    policy = ScriptedPolicy(zeros)
    assert len(run(controller(policy, contract=plain, reference=no_reference()), 4)) == 4
    assert [observation.shape for observation, _ in policy.calls] == [(3,), (3,)]
    policy = ScriptedPolicy(zeros)
    run(controller(policy, reference=MotionReference(1, {"motion_body_pos_b": [[1.0, 2.0, 3.0]]})), 4)
    assert [observation[:3].tolist() for observation, _ in policy.calls] == [[1.0, 2.0, 3.0]] * 2
    assert [float(observation[11]) for observation, _ in policy.calls] == [1.0, 1.0]


OWN, OTHERS = "RLPolicyController", "joint_names of the policy do not match the robot's joints"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints": ()}, "RLPolicyController.joints: is empty"),
        ({"control_period": 0.0}, f"{OWN}.control_period: is 0.0, expected a finite number > 0"),
        ({"control_period": NAN}, f"{OWN}.control_period: is nan"),
        ({"control_period": "fast"}, f"{OWN}.control_period: is 'fast'"),
        (
            {"control_period": 0.03},
            f"{OWN}.control_period: is 0.03 s, expected policy_dt (0.04 s) to be a whole multiple",
        ),
        ({"control_period": 0.08}, f"{OWN}.control_period: is 0.08 s, expected policy_dt"),
        ({"control_period": 0.0201}, f"{OWN}.control_period: is 0.0201 s, expected policy_dt"),
        ({"control_period": 1e9}, f"{OWN}.control_period: is 1e+09 s, expected policy_dt"),
        ({"action_limit": 0}, f"{OWN}.action_limit: is 0, expected a finite number > 0"),
        ({"action_limit": INF}, f"{OWN}.action_limit: is inf"),
        ({"joints": ("shoulder", "elbow", "hand")}, f"{OTHERS}: the robot lacks wrist; the policy lacks hand"),
        ({"joints": ("shoulder", "elbow")}, f"{OTHERS}: the robot lacks wrist"),
        ({"joints": ("shoulder", "elbow", "wrist", "neck")}, f"{OTHERS}: the policy lacks neck"),
        (
            {"contract": contract(observation=("joint_pos", "joint_torque"))},
            "unknown observation term 'joint_torque'; known: actions, base_ang_vel, ",
        ),
        ({"reference": no_reference()}, "observation term 'motion_body_pos_b' needs a tracking motion, and there is"),
        (
            {"contract": contract(observation=("key_pressed",))},
            "observation term 'key_pressed' needs a source of live key states: a piano, or a width of its own, and",
        ),
        ({"extern": {}}, "unknown observation term 'velocity'; known: actions"),
    ],
)
def test_a_policy_that_does_not_fit_is_refused(changes, message):
    with pytest.raises(FieldError, match=f"^{re.escape(message)}"):
        controller(**changes)


def test_periods_must_be_whole_multiples_but_for_rounding():
    assert ticks_per_step(0.02, 0.02 / 3) == (3, True)
    assert ticks_per_step(0.02001, 0.005) == (4, False)
    for period in (0.04 / 7, 0.04 / 3, 0.1 * 0.1, 0.04 * (1 + 1e-9)):
        assert controller(control_period=period).decimation == round(0.04 / period)
