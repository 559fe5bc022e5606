import pytest

from humanoid_sim.robots.description import load_robot
from tools.samples.arm import ArmModel


@pytest.fixture(scope="session")
def lite():
    return load_robot("lite")


@pytest.fixture(scope="session")
def arm(lite):
    return ArmModel(lite)
