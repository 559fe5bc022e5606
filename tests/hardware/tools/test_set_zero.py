import math
import re

import pytest
from lone_motor import cycle_power, lone_motors

from humanoid_sim.hardware.mock.motors import MockSettings
from humanoid_sim.hardware.tools import only_motor as tool

_CHANNEL = "virtual:bench-set-zero"
_MOUNTED = MockSettings(homing_offset={"left_elbow_pitch": 1.25})
_AGAIN = ("set-zero", _CHANNEL, "--yes")


def _shown(motors):
    """rad, what the motor calls its position now."""
    found = []

    def look(mock):
        found.append(mock.plant.shaft[3] - mock.motors[3].origin)

    motors.call(look)
    return found[0]


def test_the_present_position_becomes_zero_and_stays_so(run):
    with lone_motors(_CHANNEL, settings=_MOUNTED) as motors:
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
    with lone_motors(_CHANNEL, settings=_MOUNTED) as motors:
        before = _shown(motors)
        assert run("set-zero", _CHANNEL)[::2] == (2, "error: the zero was not changed: not confirmed\n")
        assert _shown(motors) == pytest.approx(before, abs=0.005)


def test_several_motors_are_refused(run):
    with lone_motors(_CHANNEL, (3, 4, 5), settings=_MOUNTED) as motors:
        before = _shown(motors)
        status, _, complained = run(*_AGAIN)
        assert _shown(motors) == pytest.approx(before, abs=0.005)
    assert status == 2
    assert "3 motors answer, expected one alone on the bus" in complained


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("run_mode", "1", "run_mode is 1.0, expected 0: in mode 1 the zero is ignored"),
        ("add_offset", "0.5", "add_offset is 0.5 rad, which moves its zero at the next power-on"),
    ],
)
def test_a_motor_whose_zero_would_not_stay_is_refused(run, name, value, message):
    with lone_motors(_CHANNEL):
        assert run("param", "set", _CHANNEL, "127", name, value)[0] == 0
        status, _, complained = run(*_AGAIN)
    assert status == 2
    assert message in complained


def test_a_shaft_that_turns_is_refused(run, monkeypatch):
    positions = iter([0.3, 0.3, 0.35])
    monkeypatch.setattr(tool, "_position", lambda _: next(positions))
    with lone_motors(_CHANNEL, settings=_MOUNTED):
        status, _, complained = run(*_AGAIN)
    assert (status, "its shaft turns" in complained) == (2, True)
