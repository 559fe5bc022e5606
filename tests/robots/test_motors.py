"""The motors' limits, against the table that they are from, and the ids that two families may share a bus with."""

import json
from pathlib import Path

import pytest

from humanoid_sim.robots.motors import FAMILIES, MOTORS, id_problem

TABLE = Path(__file__).parents[3] / "shared" / "data" / "actuators.json"


@pytest.mark.skipif(not TABLE.is_file(), reason="the table of actuators is not beside the checkout")
def test_ranges_are_the_tables():
    models = json.loads(TABLE.read_text(encoding="utf-8"))["models"]
    assert {model["model"] for model in models} == {m.name for m in MOTORS.values() if m.family == "robstride"}
    for model in models:
        limits, motor = model["mit_limits"], MOTORS[model["model"]]
        assert (motor.stiffness, motor.damping) == (limits["kp"], limits["kd"])
        assert (motor.velocity, motor.effort) == (limits["velocity"], limits["torque"])


def test_ids_of_one_family_that_the_others_frames_could_address():
    robstride, sito, both = FAMILIES["robstride"], FAMILIES["sito"], {"robstride", "sito"}
    assert [i for i in range(256) if id_problem(robstride, i, {"robstride"})] == [0, *range(128, 256)]
    assert [i for i in range(128) if id_problem(robstride, i, both)] == [0, 1, 9, 69]
    assert [i for i in range(257) if id_problem(sito, i, {"sito"})] == [0, 256]
    assert [i for i in range(256) if id_problem(sito, i, both)] == [0, *range(128, 256)]
