"""A fit finds what was planted, says what it cannot know, and its intervals do not shrink with copies of the data."""

import dataclasses

import msgspec
import numpy as np
import pytest
from planted_arm import TRUTH, arm, emulated, motion, planted, simulated, true_values

pytest.importorskip("colorama")  # of mujoco[sysid]

from humanoid_sim.sysid.data import Window, windows
from humanoid_sim.sysid.fit import fit
from humanoid_sim.sysid.judgement import judge
from humanoid_sim.sysid.model import KINDS


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def run(robot):
    return simulated(planted(robot), motion(15.0))


@pytest.fixture(scope="module")
def fitted(robot, run):
    return fit(robot, windows(run, (0.0, 2 / 3)))


def test_all_that_was_planted_is_found(fitted):
    truth = true_values()
    for item in fitted.parameters:
        (place,) = item.parameter.places
        assert item.is_decided, item
        error, floor = abs(item.value - truth[place]), {"delay": 1e-3, "offset": 3e-3}
        assert error <= floor.get(item.parameter.kind, 0.1 * truth[place]), item
        assert error <= 2.5 * item.half_width, item


def test_it_predicts_what_it_did_not_see(fitted, run):
    judgement = judge(fitted, windows(run, (2 / 3, 1.0)))
    assert judgement.is_better
    assert (judgement.ratio[:2] < 0.2).all()
    assert not list(judgement.unexplained(("shoulder", "elbow")))


def test_a_model_that_is_right_already_is_not_made_better(robot):
    right = planted(robot)
    run = simulated(right, motion(8.0), offset=0.0)
    found = fit(right, windows(run, (0.0, 2 / 3)), kinds=("friction", "damping"))
    assert not judge(found, windows(run, (2 / 3, 1.0))).is_better


def test_copies_of_the_data_do_not_narrow_an_interval(robot, run, fitted):
    once = windows(run, (0.0, 2 / 3))
    thick = _every_tick_twice(run)
    twice = fit(robot, windows(thick, (0.0, 2 / 3)))
    assert [w.duration for w in once] == pytest.approx([w.duration for w in windows(thick, (0.0, 2 / 3))], abs=0.05)
    for a, b in zip(fitted.parameters, twice.parameters, strict=True):
        assert b.half_width >= 0.8 * a.half_width, (a, b)


def _every_tick_twice(run):
    """The same reports and commands at twice the rate, each told twice."""
    fields = {
        name: np.repeat(getattr(run, name), 2, axis=0)
        for name in ("position", "velocity", "effort", "command", "quaternion")
    }
    time, age = np.repeat(run.time, 2), np.repeat(run.age, 2, axis=0)
    time[1::2] += 0.005
    age[1::2] += 0.005
    return dataclasses.replace(run, time=time, age=age, **fields)


def test_a_robot_that_hardly_moved_stays_as_it_is(robot):
    run = simulated(planted(robot), np.zeros((300, 2)))
    found = fit(robot, windows(run))
    own = {item.parameter.name: item for item in found.parameters}
    for name in ("shoulder armature", "shoulder damping", "elbow armature", "elbow damping", "elbow delay"):
        assert not own[name].is_decided, name
        assert own[name].value == own[name].parameter.old
    assert found.new[KINDS.index("damping"), 1] == 0.0


def test_a_mass_that_the_model_lacks_is_reported(robot, tmp_path):
    arm(tmp_path)
    text = (tmp_path / "arm.xml").read_text().replace('size=".02" mass=".5"', 'size=".02" mass="1.5"')
    (tmp_path / "arm.xml").write_text(text)
    heavy = msgspec.structs.replace(planted(robot), folder=str(tmp_path))
    run = simulated(heavy, motion(10.0))
    found = fit(robot, windows(run, (0.0, 2 / 3)))
    assert list(judge(found, windows(run, (2 / 3, 1.0))).unexplained(("shoulder", "elbow")))


def test_emulated_motors_with_their_bus(robot):
    run = emulated(planted(robot), motion(12.0))
    found, truth = fit(robot, windows(run, (0.0, 2 / 3))), true_values()
    assert judge(found, windows(run, (2 / 3, 1.0))).is_better
    for item in found.parameters:
        (place,) = item.parameter.places
        allowed = {"delay": 1.5e-3, "offset": 3e-3}.get(item.parameter.kind, 0.1 * truth[place])
        assert not item.is_decided or abs(item.value - truth[place]) <= allowed, item


def test_windows_end_where_a_joint_is_not_heard(run):
    age = run.age.copy()
    age[300] = 1.0
    for window in windows(dataclasses.replace(run, age=age)):
        assert not window.first <= 300 < window.last
    assert isinstance(windows(run)[0], Window)


def test_the_truth_of_the_rig_is_not_the_description(robot):
    assert planted(robot).joints[0].dynamics == TRUTH[0]
    assert robot.joints[0].dynamics is None
