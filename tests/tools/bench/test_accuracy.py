from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.errors import InputError
from tools.bench.accuracy import commanded_motion, plant_errors


@pytest.fixture(scope="module")
def wave():
    scenario = make_scenario("lite_tracking", "lite", "wave")
    return commanded_motion(scenario.description, scenario.wiring, scenario.policy, 0.6)


def test_a_motion_is_what_the_policy_commanded(wave):
    assert wave.period == 0.02
    assert len(wave.commands) == 30
    assert {command.position.shape for command in wave.commands} == {(14,)}
    assert float(np.abs(wave.commands[-1].position - wave.commands[0].position).max()) > 0.01


def test_errors_grow_with_the_step_and_the_exact_plants_agree(wave):
    reference, affine, short, long = plant_errors(
        wave, [("qfrc_applied", None), ("affine", None), ("implicit", None), ("implicit", 0.005)]
    )
    assert (affine.timestep, short.timestep, long.timestep) == (0.0005, 0.0025, 0.005)
    assert reference.hands_rms == pytest.approx(affine.hands_rms, rel=1e-6)
    assert affine.hands_rms < 0.0002
    assert 0.00005 < short.hands_rms < 0.0006
    assert 1.6 * short.hands_rms < long.hands_rms < 2.4 * short.hands_rms
    assert 1.6 * short.joints_rms < long.joints_rms < 2.4 * short.joints_rms
    assert short.hands_rms < short.hands_most
    assert short.speed > 0.0


def test_gains_that_the_plant_cannot_take_are_refused(wave):
    with pytest.raises(InputError, match="unstable above 2"):
        plant_errors(wave, [("affine", 0.005)])
    stiff = replace(wave, commands=wave.commands[:1])
    assert len(plant_errors(stiff, [("implicit", None)])) == 1
