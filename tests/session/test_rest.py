import numpy as np
import pytest
import rig
from fakes import BrokenError, FakeRobot, is_damping, is_zero

from humanoid_sim.mit import MITCommand
from humanoid_sim.session.rest import RestDetector, damp_without_supervisor

CONTROLLERS = rig.supervisor().controllers


def moving(velocity):
    return rig.state(joint_velocity=np.array([0.0, velocity, 0.0]))


@pytest.mark.parametrize(("period", "needed"), [(0.005, 101), (0.02, 26), (1.0, 2)])
def test_rest_is_half_a_second_without_motion(period, needed):
    rest = RestDetector(period)
    assert [rest.update(moving(0.019)) for _ in range(needed)] == [False] * (needed - 1) + [True]


def test_motion_of_either_sign_starts_the_half_second_again():
    for velocity in (0.021, -0.021, 3.0):
        rest = RestDetector(0.02)
        for _ in range(25):
            rest.update(moving(0.0))
        assert not rest.update(moving(velocity))
        assert not any(rest.update(moving(0.0)) for _ in range(25))
        assert rest.update(moving(0.0))


@pytest.mark.parametrize(
    "unknown",
    [
        {"joint_velocity": np.full(3, np.nan)},
        *({"joint_age": np.array([0.0, age, 0.0])} for age in (0.21, 3.0, np.inf, np.nan)),  # silent while it was slow
    ],
)
def test_what_nobody_knows_is_no_rest(unknown):
    rest = RestDetector(1.0)
    assert not any(rest.update(rig.state(**unknown)) for _ in range(10))
    assert [rest.update(moving(0.0)) for _ in range(2)] == [False, True]


def damp(robot, longest=1.0, **options):
    start = rig.state(position=rig.KNOWN)
    settings = {"period": rig.PERIOD, "longest": longest, "pause": None, **options}
    return damp_without_supervisor(robot, CONTROLLERS, start, **settings)


def fail(count):
    raise BrokenError


def test_keeps_the_pace_of_the_loop_and_a_state_that_cannot_be_read_is_the_last_one():
    pauses = []
    damp(FakeRobot(velocity=1.0), longest=0.1, pause=pauses.append)
    assert pauses == [rig.PERIOD] * 6
    robot = FakeRobot(on_read=fail)
    damp(robot, longest=0.1)
    assert {tuple(command.position) for command in robot.commands} == {rig.KNOWN}


class Raises:
    def activate(self, tick_input):
        raise BrokenError


class NotFinite:
    def activate(self, tick_input):
        return self

    def update(self, memory, tick_input):
        return memory, MITCommand(*[np.full(3, np.nan)] * 5)


@pytest.mark.parametrize("controllers", [{}, {"damping_controller": Raises()}, {"damping_controller": NotFinite()}])
def test_without_a_controller_that_works_the_command_is_zero_torque(controllers):
    robot = FakeRobot()
    damp_without_supervisor(robot, controllers, rig.state(), period=rig.PERIOD, longest=0.1, pause=None)
    assert [is_zero(command) for command in robot.commands] == [True] * 6


def test_an_impatient_interrupt_is_heard_when_the_robot_is_damped():
    def interrupt(count):
        if count == 1:
            raise KeyboardInterrupt

    robot = FakeRobot(on_write=interrupt)
    with pytest.raises(KeyboardInterrupt):
        damp(robot, longest=0.1)
    assert len(robot.commands) >= 5
    assert all(is_damping(command) for command in robot.commands)
