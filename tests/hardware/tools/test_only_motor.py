"""`hardware set-id` and `set-zero`: a bus with one of the Lite's motors, as delivered, the others without power."""

import math
from contextlib import contextmanager

import pytest

from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot

CHANNEL = "virtual:bench-only"
LITE = load_robot("lite")
ELBOW = 3
"""Index of the motor that is alone, an rs-00."""


@contextmanager
def lone_motors(*others):
    """The elbow's motor, and others by index, with the factory's id; the rest has no power."""

    def deliver(mock):
        for i, motor in enumerate(mock.motors):
            motor.can_id = 127
            if i not in (ELBOW, *others):
                mock.set_power(i, False)

    with MockServer(LITE, [CHANNEL], homing_offset={LITE.joint_names[ELBOW]: 1.25}) as motors:
        motors.call(deliver)
        yield motors


def cycle_power(motors, motor=ELBOW):
    def cycle(mock):
        mock.set_power(motor, False)
        mock.set_power(motor, True)

    motors.call(cycle)


def ids(motors, *indices):
    found = []
    motors.call(lambda mock: found.extend(mock.motors[i].can_id for i in indices))
    return found


def position(motors):
    """rad, what the elbow's motor calls its position now."""
    found = []
    motors.call(lambda mock: found.append(mock.plant.shaft[ELBOW] - mock.motors[ELBOW].origin))
    return found[0]


def test_a_motor_from_the_factory_gets_its_id_and_keeps_it(run):
    with lone_motors() as motors:
        status, printed, complained = run("set-id", CHANNEL, "14", "--yes")
        assert (status, complained) == (0, "")
        lines = printed.splitlines()
        assert lines[0].startswith(f"found motor 127 on {CHANNEL}, unique id ")
        assert lines[1] == "motor 127 is now 14, read back and saved"
        cycle_power(motors)
        assert ids(motors, ELBOW) == [14]
        assert run("set-id", CHANNEL, "14")[1].endswith("it has the id 14 already: nothing was changed\n")


@pytest.mark.parametrize("tool", [("set-id", CHANNEL, "14"), ("set-zero", CHANNEL)])
@pytest.mark.parametrize("whole", [False, True], ids=["two with one id", "a whole robot"])
def test_several_motors_are_refused(run, tool, whole):
    with MockServer(LITE, [CHANNEL]) if whole else lone_motors(4) as motors:
        before = ids(motors, *range(14))
        status, _, complained = run(*tool, "--yes")
        assert ids(motors, *range(14)) == before
    assert status == 2
    found = f"{14 if whole else 2} motors answer, expected one alone on the bus: {11 if whole else 127} (unique id "
    assert complained.startswith(f"error: {CHANNEL}: {found}")


def test_the_present_position_becomes_zero_and_stays_so(run):
    with lone_motors() as motors:
        assert abs(position(motors)) > 0.5
        status, printed, complained = run("set-zero", CHANNEL, "--yes")
        assert (status, complained) == (0, "")
        assert printed.splitlines()[-1].endswith("read back and saved")
        cycle_power(motors)
        assert abs(math.remainder(position(motors), 2.0 * math.pi)) < 0.005  # 0 to 2π: a turn is not known


def test_a_zero_that_is_not_confirmed_or_not_accepted_is_reported(run, types):
    types("no")
    with lone_motors() as motors:
        before = position(motors)
        assert run("set-zero", CHANNEL)[::2] == (2, "error: the zero was not changed: not confirmed\n")
        assert position(motors) == pytest.approx(before, abs=0.005)
        assert run("param", CHANNEL, "127", "run_mode", "--value", "1")[0] == 0
        status, _, complained = run("set-zero", CHANNEL, "--yes")
    assert (status, "after its zero was set, expected 0" in complained) == (2, True)
