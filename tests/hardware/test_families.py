from humanoid_sim.hardware.families import DRIVERS
from humanoid_sim.robots.motors import FAMILIES, MOTORS


def test_every_family_has_a_driver_and_models():
    assert set(DRIVERS) == set(FAMILIES) == {model.family for model in MOTORS.values()}


def test_whoever_takes_every_frame_is_asked_last():
    assert list(DRIVERS)[-1] == "robstride"
