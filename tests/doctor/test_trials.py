import msgspec
import numpy as np
import pytest
from models import contract_of

from humanoid_sim.doctor.examined_policy import ExaminedPolicy
from humanoid_sim.doctor.trials import Trial, TrialRunner
from humanoid_sim.robots.description import load_robot

BIPED = load_robot("lite_biped")


def still(observation, frame):
    return np.zeros(BIPED.joint_count, dtype=np.float32)


def standing(**changes):
    """The Lite's legs held by a policy that always answers zeros."""
    values = {
        "joint_stiffness": 80.0,
        "joint_damping": 2.0,
        "default_joint_pos": np.array(BIPED.initial_position),
        "observation": ("base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos", "joint_vel", "actions"),
        "command_names": ("twist",),
        "action_scale": 0.25,
    }
    return contract_of(BIPED.joint_names, **{**values, **changes})


@pytest.fixture(scope="module")
def trials():
    return TrialRunner(ExaminedPolicy(standing(), still, BIPED))


def test_what_stands_stays_up_to_the_end(trials):
    outcome = trials.run(standing(), Trial(2.0))
    assert outcome.lost == ""
    assert outcome.time_up == 2.0
    assert outcome.quality["velocity"] < 0.1
    assert outcome.cost == sum(outcome.quality.values())
    assert set(outcome.quality) == {"velocity", "turning", "tilt", "height", "shaking", "torque"}


def test_what_is_too_soft_falls_early(trials):
    outcome = trials.run(standing(joint_stiffness=5.0), Trial(3.0))
    assert 0.1 < outcome.time_up < 2.0
    assert outcome.lost.startswith("fell: ")


def test_a_trial_can_be_repeated_to_the_bit(trials):
    soft = standing(joint_stiffness=20.0)
    first = trials.run(soft, Trial(1.0))
    trials.run(standing(), Trial(0.5))
    again = trials.run(soft, Trial(1.0))
    fresh = TrialRunner(trials.examined).run(soft, Trial(1.0))
    assert first == again == fresh


def test_the_command_counts(trials):
    outcome = trials.run(standing(), Trial(2.0, (0.5, 0.0, 0.0)))
    assert outcome.quality["velocity"] == pytest.approx(0.5 / 0.2, rel=0.1)


def test_a_contract_that_cannot_run_is_lost_at_once(trials):
    unknown = standing(observation=("base_ang_vel", "whatever"))
    outcome = trials.run(unknown, Trial(1.0))
    assert outcome.time_up == 0.0
    assert "whatever" in outcome.lost
    odd = trials.run(standing(policy_dt=0.0333), Trial(1.0))
    assert odd.time_up == 0.0


def test_damping_that_no_physics_step_can_take_is_said_so(trials):
    outcome = trials.run(standing(joint_damping=1e5), Trial(1.0))
    assert outcome.lost == "its damping is unstable in simulation"


def test_a_policy_that_diverges_is_lost_by_its_fault():
    def wild(observation, frame):
        return np.full(BIPED.joint_count, np.nan, dtype=np.float32)

    outcome = TrialRunner(ExaminedPolicy(standing(), wild, BIPED)).run(standing(), Trial(1.0))
    assert outcome.time_up == 0.0
    assert "action" in outcome.lost


def test_joints_that_run_away_end_a_trial_quietly(capfd, tmp_path_factory, monkeypatch):
    folder = tmp_path_factory.mktemp("log")
    monkeypatch.chdir(folder)

    def kicking(observation, frame):
        return np.full(BIPED.joint_count, 90.0 * (-1.0) ** frame, dtype=np.float32)

    contract = standing(action_scale=50.0, joint_stiffness=5000.0)
    joints = tuple(msgspec.structs.replace(joint, effort_limit=float("inf")) for joint in BIPED.joints)
    strong = msgspec.structs.replace(BIPED, joints=joints)
    outcome = TrialRunner(ExaminedPolicy(contract, kicking, strong)).run(contract, Trial(2.0))
    assert outcome.lost
    assert outcome.time_up < 1.0
    assert capfd.readouterr().err == ""
    assert list(folder.iterdir()) == []


def test_robots_are_kept_and_used_again(trials):
    fresh = TrialRunner(trials.examined)
    fresh.run(standing(), Trial(0.1))
    built = len(fresh._robots)
    for stiffness in (90.0, 100.0):
        fresh.run(standing(joint_stiffness=stiffness), Trial(0.1))
    assert len(fresh._robots) == built
    fresh.run(standing(default_joint_pos=0.1), Trial(0.1))
    assert len(fresh._robots) > built
