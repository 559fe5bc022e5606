"""A user's own reward terms: refused when they are made where that can be, else in the step that shows it."""

import re
from typing import ClassVar

import gymnasium
import numpy as np
import pytest

from humanoid_sim.envs.tasks.task import Task
from humanoid_sim.errors import InputError

ID = "humanoid_sim/LiteTracking-v0"
REST = np.zeros((3, 14), dtype=np.float32)


def elbow(sample):
    return sample.state.joint_position[..., 3]


def stepped(number, term, steps=1):
    """The terms of the last step of one environment, None, or of a batch."""
    env = (
        gymnasium.make(ID, rewards={"own": (2.0, term)})
        if number is None
        else gymnasium.make_vec(ID, num_envs=number, threads=1, rewards={"own": (2.0, term)})
    )
    env.reset(seed=0)
    for _ in range(steps):
        *_, info = env.step(REST[0] if number is None else REST[:number])
    return info["terms"]


@pytest.mark.parametrize(
    ("rewards", "message"),
    [
        ({"knees": elbow}, r"^rewards: knees is a function, expected \(weight, function\)$"),
        ({"knees": 0.5}, r"^rewards: knees is 0\.5, expected \(weight, function\)$"),
        ({"knees": (elbow, -0.01)}, r"^rewards: knees is \(a function, -0\.01\), expected \(weight, function\)$"),
        ({"knees": ("much", elbow)}, r"^rewards: knees is \(a str, a function\), expected \(weight, function\)$"),
        ({"knees": (float("nan"), elbow)}, r"^weights: knees is nan, expected a finite number$"),
        ({"knees": (1.0, elbow, 2.0)}, r"^rewards: knees is a tuple, expected \(weight, function\)$"),
        ([("knees", elbow)], r"^rewards: is a list, expected a \(weight, function\) by the name of each term$"),
    ],
)
def test_terms_that_are_none_are_refused_at_once(rewards, message):
    with pytest.raises(InputError, match=message):
        gymnasium.make(ID, rewards=rewards)


def spoilt(value, i):
    """A term that is `value` for one robot of a batch, from its third step on."""

    def term(sample):
        late = np.asarray(sample.step) >= 3
        return np.where(late & (np.arange(late.size).reshape(late.shape) == i), value, 1.0)

    return term


@pytest.mark.parametrize(("value", "what"), [(np.nan, "nan"), (np.inf, "infinite"), (-np.inf, "infinite")])
def test_a_reward_that_is_not_finite_names_term_and_environment(value, what):
    assert stepped(None, spoilt(value, 0), steps=2)["own"] == pytest.approx(0.04)
    with pytest.raises(InputError, match=f"^rewards: own is {what} in environment 0$"):
        stepped(None, spoilt(value, 0), steps=3)
    assert stepped(3, spoilt(value, 1), steps=2)["own"] == pytest.approx([0.04] * 3)
    with pytest.raises(InputError, match=f"^rewards: own is {what} in environment 1$"):
        stepped(3, spoilt(value, 1), steps=3)


def test_a_fault_is_no_error_whatever_the_terms_are_then():
    env = gymnasium.make_vec(
        ID, num_envs=2, threads=1, rewards={"own": (1.0, lambda s: np.where(np.abs(s.action[..., 0]) > 0, 1.0, np.nan))}
    )
    env.reset(seed=0)
    action = np.full((2, 14), 0.1, dtype=np.float32)
    action[1] = np.nan  # refused, and replaced by zeros
    _, reward, terminated, _, info = env.step(action)
    assert (terminated.tolist(), reward[1]) == ([False, True], 0.0)
    assert info["fault"][1]


class OwnTask(Task):
    """`GIVEN` makes of a sample what the task gives."""

    WEIGHTS: ClassVar = {"own": 1.0, **Task.WEIGHTS}
    GIVEN: ClassVar = None

    def _measure(self, sample):
        return type(self).GIVEN(sample)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            lambda sample: sample.body_position[..., 0, 2],
            rf"^task: OwnTask fails at {re.escape(__file__)}:\d+: IndexError: index 0 is out of bounds for axis 1 with "
            "size 0; its samples have 0 bodies and a base$",
        ),
        (lambda sample: sample.alignment.yaw, "fails at .*: AttributeError: 'NoneType' object has no attribute 'yaw'"),
        (lambda _: None, "OwnTask fails: TypeError: cannot unpack non-iterable NoneType object"),
        (lambda sample: ({"owm": sample.step}, sample.step > 9), r"WEIGHTS: unknown reward term 'owm'; known: own, "),
        (
            lambda sample: ({"own": sample.action}, sample.step > 9),
            r"^task: OwnTask: 'own' has shape \(3, 14\), expected \(3,\)$",
        ),
        (lambda sample: ({"own": sample.step}, False), r"says False of failure, expected bools of shape \(3,\)$"),
        (lambda sample: ({"own": sample.step}, sample.step * 0.0), r"of failure, expected bools of shape \(3,\)$"),
    ],
    ids=["bodies", "alignment", "nothing", "name", "shape", "one", "numbers"],
)
def test_a_task_of_the_user_s_that_fails_is_one_line(given, told, monkeypatch):
    monkeypatch.setattr(OwnTask, "GIVEN", staticmethod(given))
    envs = gymnasium.make_vec("humanoid_sim/BipedVelocity-v0", num_envs=3, threads=1, task=OwnTask)
    envs.reset(seed=0)
    with pytest.raises(InputError, match=told):
        envs.step(np.zeros((3, 14), dtype=np.float32))
    envs.close()
