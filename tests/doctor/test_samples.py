"""The search on a trace: the shipped walker's first steps, under its right contract, are the trainer's."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
import yaml
from plants import alike, at_rate, multiplied, no_pose, term, turned
from rich.console import Console

from humanoid_sim.assets import policy_path
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.doctor.report import examine
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.search import search_trace
from humanoid_sim.doctor.trial import load_subject
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.policy.traces import STATE_ARRAYS
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch_sim import BatchSim

STEPS = 60


@pytest.fixture(scope="module")
def walker():
    return load_subject(policy_path("lite_biped_velocity"), load_robot("lite_biped"))


@pytest.fixture(scope="module")
def steps(walker):
    """The arrays of a trace."""
    scenario, velocity, rows = walker.scenario(), np.array([[0.3, 0.1, 0.2]]), []
    with closing(BatchSim(scenario.description, 1, scenario.sim_config, implicit=True, threads=1)) as robot:
        loop = ClosedLoop(robot, scenario.wiring, velocity)
        for _ in range(STEPS):
            state, action = loop.state, scenario.policy(loop.observation[0], 0)[None]
            row = {"qpos": robot.qpos, "qvel": robot.qvel, "obs": loop.observation, "action": action}
            row |= {name: getattr(state, name) for name in STATE_ARRAYS}
            rows.append({name: array[0].copy() for name, array in row.items()})
            loop.act(action)
    arrays = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    return {**arrays, "cmd": velocity[0], "joint_names": np.array(robot.joints)}


@pytest.fixture
def search(walker, steps, tmp_path):
    def run(contract, **changed):
        path = tmp_path / "trace.npz"
        np.savez(path, **{**steps, **changed})
        subject = walker.under(contract)
        return search_trace(subject, Samples(subject, path))

    return run


def test_a_fix_that_is_pasted_into_the_contract_file_is_clean(steps, tmp_path):
    trace, file = tmp_path / "trace.npz", tmp_path / "x.contract.yaml"
    np.savez(trace, **steps)
    file.write_text("terms: {projected_gravity: {scale: -1}}")
    config = DoctorConfig(policy_path("lite_biped_velocity"), "lite_biped", contract=file, trace=trace)
    found = examine(config, Console(quiet=True))
    assert found["fix"] == {"terms": {"projected_gravity": {"scale": 1.0}}}
    file.write_text(yaml.safe_dump(found["fix"]))
    assert examine(config, Console(quiet=True))["healthy"]


def test_a_trace_whose_actions_are_a_row_late_says_so(walker, steps, search):
    with pytest.raises(InputError, match=r"action differs .*: it answers that of the row before"):
        search(walker.contract, action=np.roll(steps["action"], 1, axis=0))


def test_a_trace_of_one_row_is_compared(walker, steps, search):
    row = {name: steps[name][:1] for name in steps if name not in ("cmd", "joint_names")}
    assert search(walker.contract, **row).is_healthy


PLANTS = {
    "gyro in the world frame": term("base_ang_vel", frame="world"),
    "gains x 2": multiplied(2.0, "joint_stiffness", "joint_damping"),
    "default pose zero": no_pose,
    "25 Hz": at_rate(25.0),
}


@pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)
def test_a_planted_mistake_is_found_at_once(walker, search, plant):
    result = search(plant(walker.contract))
    assert not result.is_healthy
    assert alike(result.finding.contract, walker.contract)


@pytest.mark.parametrize("name", ["joint_stiffness", "joint_damping"])
def test_efforts_show_one_of_the_gains(walker, steps, search, name):
    right, moved = walker.contract, steps["joint_names"].tolist()
    columns = [moved.index(joint) for joint in right.joint_names]
    away = right.action_scale * steps["action"] + right.action_offset - steps["joint_position"][:, columns]
    effort = np.zeros_like(steps["joint_position"])
    effort[:, columns] = right.joint_stiffness * away - right.joint_damping * steps["joint_velocity"][:, columns]
    assert search(right, effort=effort).is_healthy
    assert alike(search(multiplied(2.0, name)(right), effort=effort).finding.contract, right)


def test_joints_that_move_at_another_rate_than_the_policy_are_told(walker, search):
    right = walker.contract  # its gait clock hides the rate
    slow = replace(right, policy_dt=2.0 * right.policy_dt, phase=replace(right.phase, period=2.0 * right.phase.period))
    assert "the joints move as if its rows were 0.022 s apart" in search(slow).note


def test_two_mistakes_are_no_finding_but_what_differs_is_named(walker, search):
    right = walker.contract
    joint = right.joint_names[3]
    result = search(turned(joint)(term("projected_gravity", scale=-1.0)(right)))
    assert result.finding is None
    assert not result.is_healthy
    assert joint in result.note
    assert "projected_gravity" in result.note


def test_the_trace_of_another_network_is_refused(walker, steps, search):
    with pytest.raises(InputError, match="action"):
        search(walker.contract, action=steps["action"] + 0.1)
    with pytest.raises(InputError, match=r"observation has shape \(60, 50\), expected \(60, 53\)"):
        search(walker.contract, obs=steps["obs"][:, :50])
