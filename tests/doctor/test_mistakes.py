"""Every deliberate mistake of the published policies as a wrong contract: it loses the robot or leaves its figures."""

from functools import cache

import pytest
from mistakes import MISTAKES, MJCF_JOINTS
from published import needs_policies
from published_policies import load_examined

from humanoid_sim.doctor.trials import Trial, TrialRunner

pytestmark = needs_policies

TRIALS = {"unitree": Trial(10.0, (0.5, 0.0, 0.0)), "holosoma": Trial(10.0, (0.5, 0.0, 0.0)), "waltz": Trial(18.9)}
BANDS = {
    # Speed 0.427 and 0.393 ± 0.02 m/s, joints 0.07 rad, position 0.13 m: in the units of `humanoid_sim.doctor.goals`.
    "unitree": {"velocity": (0.5 - 0.427 - 0.02, 0.5 - 0.427 + 0.02, 0.2)},
    "holosoma": {"velocity": (0.5 - 0.393 - 0.02, 0.5 - 0.393 + 0.02, 0.2)},
    "waltz": {"joints": (0.0, 0.07, 0.1), "position": (0.0, 0.13, 0.3)},
}


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    return {name: TrialRunner(load_examined(name, tmp_path_factory.mktemp(name))) for name in TRIALS}


@pytest.fixture(scope="module")
def outcome_of(trials):
    """What becomes of a robot with one of the mistakes."""

    @cache
    def outcome(mistake):
        tried = trials[mistake.policy]
        return tried.run(mistake.edit(tried.examined.contract), TRIALS[mistake.policy])

    return outcome


def within_band(policy, outcome):
    parts = outcome.quality
    return not outcome.lost and all(
        low <= parts[part] * unit <= high for part, (low, high, unit) in BANDS[policy].items()
    )


@pytest.mark.parametrize("policy", sorted(TRIALS))
def test_the_right_contract_stays_within_its_figures(policy, trials):
    tried = trials[policy]
    assert within_band(policy, tried.run(tried.examined.contract, TRIALS[policy]))


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: f"{mistake.policy}: {mistake.name}")
def test_a_mistake_loses_the_robot_or_leaves_its_figures(mistake, outcome_of):
    assert not within_band(mistake.policy, outcome_of(mistake))


@pytest.mark.parametrize(
    ("policy", "name", "earliest", "latest"),
    [
        ("unitree", "projected_gravity sign flipped", 0.5, 0.9),
        ("unitree", "joint_pos not relative", 1.1, 1.7),
        ("unitree", "last_action zero", 1.0, 1.5),
        ("waltz", "two rows instead of two columns", 0.2, 0.7),
        ("waltz", "command relative to default pose", 0.5, 1.2),
        ("holosoma", "terms in listed order instead of alphabetical", 0.05, 0.3),
        ("holosoma", "action scale 1", 0.3, 0.7),
    ],
)
def test_robots_fall_when_the_readme_says(policy, name, earliest, latest, outcome_of):
    (mistake,) = (mistake for mistake in MISTAKES if (mistake.policy, mistake.name) == (policy, name))
    assert earliest < mistake.lost_at < latest
    assert earliest < outcome_of(mistake).time_up < latest


def test_the_robot_is_the_one_of_the_joint_order(trials):
    assert trials["waltz"].examined.description.joint_names == MJCF_JOINTS
