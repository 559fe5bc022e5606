import math
import re

import pytest
from lone_motor import cycle_power, lone_motors

_CHANNEL = "virtual:bench-set-zero"
_MOUNTED = {"left_elbow_pitch": 1.25}
_AGAIN = ("set-zero", _CHANNEL, "--yes")


def _shown(motors):
    """rad, what the motor calls its position now."""
    found = []

    def look(mock):
        found.append(mock.plant.shaft[3] - mock.motors[3].origin)

    motors.call(look)
    return found[0]


def test_the_present_position_becomes_zero_and_stays_so(run):
    with lone_motors(_CHANNEL, homing_offset=_MOUNTED) as motors:
        before = _shown(motors)
        assert abs(before) > 0.5
        status, printed, complained = run(*_AGAIN)
        assert (status, complained) == (0, "")
        lines = printed.splitlines()
        told = re.fullmatch(r"its position is (\S+) rad; a calibration of its joint is void afterwards", lines[1])
        assert float(told[1]) == pytest.approx(before, abs=0.005), "the joint sinks by a little meanwhile"
        assert lines[2].endswith("read back and saved")
        assert abs(_shown(motors)) < 0.005
        cycle_power(motors)
        assert abs(math.remainder(_shown(motors), 2.0 * math.pi)) < 0.005  # 0 to 2π: a turn is not known


def test_without_confirmation_nothing_is_changed(run, types):
    types("no")
    with lone_motors(_CHANNEL, homing_offset=_MOUNTED) as motors:
        before = _shown(motors)
        assert run("set-zero", _CHANNEL)[::2] == (2, "error: the zero was not changed: not confirmed\n")
        assert _shown(motors) == pytest.approx(before, abs=0.005)


def test_several_motors_are_refused(run):
    with lone_motors(_CHANNEL, (3, 4, 5), homing_offset=_MOUNTED) as motors:
        before = _shown(motors)
        status, _, complained = run(*_AGAIN)
        assert _shown(motors) == pytest.approx(before, abs=0.005)
    assert status == 2
    assert "3 motors answer, expected one alone on the bus" in complained


def test_a_zero_that_the_motor_does_not_take_is_reported(run):
    with lone_motors(_CHANNEL, homing_offset=_MOUNTED):
        assert run("param", "set", _CHANNEL, "127", "run_mode", "1")[0] == 0
        status, _, complained = run(*_AGAIN)
    assert (status, "after its zero was set, expected 0" in complained) == (2, True)
