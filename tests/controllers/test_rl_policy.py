"""LOCOMOTION: the policy's view, its rate, its motion and its failures."""

import re
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from rig import BAD_ANSWERS, JOINTS, PERIOD, contract, good_answer, reference, tick

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.reference import MotionReference, no_reference
from humanoid_sim.controllers.rl_policy import RLPolicyController, ticks_per_step
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import PolicyStep
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


@pytest.mark.parametrize("order", list(permutations(JOINTS)))
def test_a_permuted_robot_gets_the_same_command_joint_by_joint(order):
    """The same robot in another joint order: each joint is told the same, bit for bit, step after step."""
    place = [JOINTS.index(name) for name in order]
    position = np.array([0.4, 0.5, 0.6])
    straight = run(controller(good_answer), 6, position=tuple(position))
    permuted = run(controller(good_answer, joints=order), 6, position=tuple(position[place]))
    assert len(straight) == len(permuted) == 6
    for (_, command), (_, other) in zip(straight, permuted, strict=True):
        for name in ("position", "velocity", "effort", "stiffness", "damping"):
            assert getattr(command, name)[place].tobytes() == getattr(other, name).tobytes()


@pytest.mark.parametrize("order", list(permutations(JOINTS)))
def test_a_permuted_policy_moves_the_same_joints(order):
    """The policy's joint order changes what it sees, not which joint an action moves."""
    values = {"wrist": (31.0, 3.1, 0.01), "elbow": (32.0, 3.2, 0.02), "shoulder": (33.0, 3.3, 0.03)}
    stiffness, damping, default = zip(*(values[name] for name in order), strict=True)
    permuted = contract(joint_names=order, joint_stiffness=stiffness, joint_damping=damping, default_joint_pos=default)
    ((_, command),) = run(controller(lambda *_: [1.0, -1.0]), 1)
    ((_, other),) = run(controller(lambda *_: [1.0, -1.0], contract=permuted), 1)
    assert fingerprint(command) == fingerprint(other)


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


def test_the_policy_step_is_reported_as_it_was():
    policy = ScriptedPolicy(good_answer)
    ((memory, _),) = run(controller(policy), 1)
    step = memory.policy_step
    assert isinstance(step, PolicyStep)
    assert step.observation.tobytes() == policy.calls[0][0].tobytes()
    assert step.action.tolist() == np.asarray(good_answer(*policy.calls[0]), dtype=np.float32).tolist()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("NaN", "action of shoulder is nan, expected a magnitude <= 100"),
        ("infinite", "action of elbow is -inf, expected a magnitude <= 100"),
        ("beyond float32", "action of elbow is inf, expected a magnitude <= 100"),
        (
            "over the limit",
            "action of elbow is 100.5, expected a magnitude <= 100: "
            "--action-limit, or action_limit in a contract.yaml, raises it",
        ),
        ("too short", "action has shape (1,), expected (2,)"),
        ("too long", "action has shape (3,), expected (2,)"),
        ("a batch", "action has shape (1, 2), expected (2,)"),
        ("a scalar", "action has shape (), expected (2,)"),
        ("ragged", "policy failed: setting an array element with a sequence."),
        ("text", "policy failed: answered values of type <U4, expected floats"),
        ("texts of numbers", "policy failed: answered values of type <U3, expected floats"),
        ("integers", "policy failed: answered values of type int64, expected floats"),
        ("a masked array", "policy failed: answered a masked array, expected floats"),
        ("a record", "policy failed: answered values of type [('left', '<f4')], expected floats"),
        ("nothing", "policy failed: answered values of type object, expected floats"),
        ("raises", "policy failed: no such tensor"),
        ("writes", "policy failed: assignment destination is read-only"),
    ],
)
def test_a_policy_that_misbehaves_is_a_fault(name, message):
    assert set(BAD_ANSWERS) == {
        "NaN", "infinite", "beyond float32", "over the limit", "too short", "too long", "a batch", "a scalar",
        "ragged", "text", "texts of numbers", "integers", "a masked array", "a record", "nothing", "raises", "writes",
    }  # fmt: skip
    (fault,) = run(controller(BAD_ANSWERS[name]), 3)
    assert isinstance(fault, Fault)
    assert fault.message.startswith(message)
    assert (fault.policy_error is not None) == message.startswith("policy failed: ")
    assert fault.policy_error is None or fault.message == f"policy failed: {fault.policy_error}"
    if name == "NaN":  # what the policy answered is part of the fault
        assert fault.policy_step.frame == 0
        assert np.isnan(fault.policy_step.action[1])


@pytest.mark.parametrize(
    ("limit", "action", "ok"),
    [(2.0, 2.0, True), (2.0, -2.0, True), (2.0, 2.001, False), (1e300, 1e39, False), (1e300, -INF, False)],
)
def test_the_action_limit_is_a_parameter(limit, action, ok):
    (result,) = run(controller(lambda *_: [0.0, action], action_limit=limit), 1)
    assert isinstance(result, Fault) == (not ok)


def test_a_later_failure_is_a_fault_too():
    answers = iter([[0.0, 0.0], [0.0, 0.0], [NAN, 0.0]])
    results = run(controller(lambda *_: next(answers)), 9)
    assert len(results) == 5
    assert isinstance(results[-1], Fault)


@pytest.mark.parametrize("value", [NAN, INF, -INF, 1e300])
def test_an_observation_that_is_not_finite_is_a_fault(value):
    policy = ScriptedPolicy(zeros)
    (fault,) = run(controller(policy), 1, position=(0.0, value, 0.0))
    shown = "inf" if value == 1e300 else str(value)
    assert isinstance(fault, Fault)
    assert fault.message == f"observation joint_pos[1] is {shown}, expected a finite number"
    assert policy.calls == []


@pytest.mark.parametrize(
    ("value", "message"),
    [
        *((np.ones(n), f"MITState.extern['velocity']: has shape ({n},), expected (3,)") for n in (1, 2, 4)),
        ([0.0, NAN, 0.0], "observation velocity[1] is nan, expected a finite number"),
    ],
)
def test_a_live_term_of_another_width_or_that_is_not_finite_is_a_fault(value, message):
    (fault,) = run(controller(), 1, extern={"velocity": Extern(value, 0.0)})
    assert isinstance(fault, Fault)
    assert fault.message == message


@pytest.mark.parametrize(
    ("extern", "seen"),
    [
        ({}, [0.0, 0.0, 0.0]),
        ({"velocity": Extern([1.0, 2.0, 3.0], 9.9, timeout=0.5)}, [1.0, 2.0, 3.0]),
        ({"velocity": Extern([1.0, 2.0, 3.0], 9.0, timeout=0.5)}, [0.0, 0.0, 0.0]),
        ({"velocity": Extern([NAN, 2.0, 3.0], 9.0, timeout=0.5)}, [0.0, 0.0, 0.0]),
    ],
)
def test_a_live_term_that_is_missing_or_too_old_is_zero(extern, seen):
    policy = ScriptedPolicy(zeros)
    run(controller(policy), 1, start=10.0, extern=extern)
    assert policy.calls[0][0][12:].tolist() == seen


def test_a_state_of_another_width_is_a_fault_at_any_tick():
    rl = controller()
    memory, _ = rl.update(rl.activate(tick()), tick())
    wide = tick(PERIOD, position=(0.0, 0.0, 0.0, 0.0))
    for fault in (rl.activate(wide), rl.update(memory, wide)):
        assert isinstance(fault, Fault)
        assert fault.message == "state has (4,) joint positions, expected (3,)"


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
