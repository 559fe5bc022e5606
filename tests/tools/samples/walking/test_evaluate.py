import json

import numpy as np
import onnxruntime
import pytest

from humanoid_sim.assets import WALKING_POLICY
from humanoid_sim.cli import run_program
from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from tools.samples import main
from tools.samples.walking.evaluate import CASES, WalkingCase, run_case

pytestmark = pytest.mark.slow  # of the shipped policy, by the metrics that it was trained for


def test_the_cases_are_those_that_the_policy_is_judged_by():
    assert [case.command for case in CASES[:8]] == [
        (0.0, 0.0, 0.0),
        (0.6, 0.0, 0.0),
        (0.3, 0.0, 0.0),
        (-0.3, 0.0, 0.0),
        (0.0, 0.2, 0.0),
        (0.0, -0.2, 0.0),
        (0.0, 0.0, 0.5),
        (0.0, 0.0, -0.5),
    ]
    assert CASES[0].seconds == 60.0
    assert {case.seconds for case in CASES[1:8]} == {20.0}
    assert [case.velocity_push for case in CASES if case.velocity_push] == [0.4, 0.4]
    assert [case.force_push for case in CASES if case.force_push] == [0.2, 0.2, 0.4, 0.4]


def test_the_shipped_policy_stands_and_walks():
    """A sample of the table in docs/training.md, on the plant that it was not trained on."""
    scenario = make_scenario(WALKING_POLICY, "lite_biped", task="velocity")
    assert scenario.physics_timestep == 0.0005
    still = run_case(scenario, WALKING_POLICY, WalkingCase("stand", (0.0, 0.0, 0.0), 3.0), range(2))
    assert (still.survived, still.seeds) == (2, 2)
    assert still.speed_error < 0.02
    assert still.drift < 0.05
    walks = run_case(scenario, WALKING_POLICY, WalkingCase("forward", (0.3, 0.0, 0.0), 5.0), range(2))
    assert walks.survived == 2
    assert walks.drift > 0.3
    assert walks.at_limit < 0.05
    assert walks.touchdown > 0.0


def test_a_robot_that_is_pushed_over_has_not_survived():
    scenario = make_scenario(WALKING_POLICY, "lite_biped", task="velocity", actuation="implicit")
    for push in ({"velocity_push": 2.0}, {"force_push": 3.0}):
        case = WalkingCase("pushed", (0.0, 0.0, 0.0), 6.5, **push)
        assert run_case(scenario, WALKING_POLICY, case, range(2)).survived == 0


def test_the_shipped_policy_withstands_pushes_and_stands_again():
    scenario = make_scenario(WALKING_POLICY, "lite_biped", task="velocity", actuation="implicit")
    for case in (
        WalkingCase("pushed while it walks", (0.3, 0.0, 0.0), 7.0, velocity_push=0.4),
        WalkingCase("pushed while it stands", (0.0, 0.0, 0.0), 7.0, velocity_push=0.4),
        WalkingCase("pushed on its pelvis", (0.0, 0.0, 0.0), 7.0, force_push=0.2),
    ):
        assert run_case(scenario, WALKING_POLICY, case, range(8)).survived >= 7


def test_walking_begins_and_ends_at_any_moment_of_the_clock():
    """The gait's clock runs while the robot stands, and does not wait for a command."""
    envs = PolicyVectorEnv(
        32, WALKING_POLICY, "lite_biped", actuation="implicit", physics_timestep=0.0025, autoreset_mode="SameStep"
    )
    session = onnxruntime.InferenceSession(str(WALKING_POLICY), providers=["CPUExecutionProvider"])
    observation, _ = envs.reset(seed=0, options={"command": (0.0, 0.0, 0.0)})
    moment = np.arange(32)  # policy steps, in a cycle of 32
    for step in range(362):  # the last one has 3 s to come to rest
        walks = (step >= 50 + moment) & (step < 150 + 2 * moment)
        envs._commands[:] = np.where(walks[:, None, None], (0.4, 0.0, 0.2), 0.0)
        observation, _, fallen, _, _ = envs.step(session.run(None, {"obs": observation})[0])
        assert not fallen.any(), f"step {step}: robots {np.flatnonzero(fallen).tolist()}"
    assert float(np.abs(envs.simulation.qvel).max()) < 0.3
    envs.close()


def test_the_command_writes_its_figures(tmp_path, capsys):
    output = tmp_path / "figures.json"
    options = ["evaluate-walking", "--only", "turn left", "--seeds", "1", "--actuation", "implicit"]
    assert main([*options, "--json", str(output)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:3] == ["case", "stayed", "up"]
    (row,) = json.loads(output.read_text())
    assert (row["name"], row["seeds"]) == ("turn left 0.5", 1)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--seeds", "0"), "error: --seeds: is 0, expected at least 1\n"),
        (("--only", "jump"), "error: --only: is 'jump', expected part of one of stand, forward 0.6"),
    ],
)
def test_bad_options_are_one_line(options, expected, capsys):
    assert run_program(main, ["evaluate-walking", *options]) == 2
    assert expected in capsys.readouterr().err
