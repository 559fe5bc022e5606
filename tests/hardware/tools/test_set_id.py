import io

import pytest
from lone_motor import cycle_power, lone_motors

from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot

pytestmark = pytest.mark.usefixtures("quick_search")


_CHANNEL = "virtual:bench-set-id"


def _ids(motors, *indices):
    return [motors._motors.motors[i].can_id for i in indices]


def test_a_motor_from_the_factory_gets_its_id_and_keeps_it(run):
    with lone_motors(_CHANNEL) as motors:
        status, printed, complained = run("set-id", _CHANNEL, "14", "--yes")
        assert (status, complained) == (0, "")
        lines = printed.splitlines()
        assert lines[0].startswith(f"found motor 127 on {_CHANNEL} (rs-00, firmware 0.0.3.255, unique id ")
        assert lines[0].endswith("), and nobody else")
        assert lines[1] == "motor 127 is now 14, read back and saved"
        assert lines[-1] == f"  python -m humanoid_sim.hardware ping {_CHANNEL} 14"
        assert _ids(motors, 3) == [14]
        cycle_power(motors)
        assert _ids(motors, 3) == [14]
        status, printed, _ = run("discover", _CHANNEL, "--wait", "0.001", "--firmware")
        assert status == 0
        assert " 14 " in printed
        assert " 127 " not in printed


def test_a_motor_that_has_the_id_is_left_alone(run):
    with lone_motors(_CHANNEL):
        status, printed, _ = run("set-id", _CHANNEL, "127")
    assert status == 0
    assert printed.endswith("it has the id 127 already: nothing was changed\n")


@pytest.mark.parametrize("indices", [(3, 4), range(14)], ids=["with one id", "a whole robot"])
def test_several_motors_are_refused(run, indices):
    whole = len(indices) == 14
    with MockServer(load_robot("lite"), [_CHANNEL]) if whole else lone_motors(_CHANNEL, indices) as motors:
        before = _ids(motors, *indices)
        status, _, complained = run("set-id", _CHANNEL, "14", "--yes")
        assert _ids(motors, *indices) == before == ([*range(11, 18), *range(21, 28)] if whole else [127, 127])
    assert status == 2
    found = f"{len(indices)} motors answer, expected one alone on the bus: {before[0]} (unique id "
    assert complained.startswith(f"error: {_CHANNEL}: {found}")


ANSWERS = {"yes\n": "", "y\n": "the id was not changed: not confirmed", "": "the id was not changed: not confirmed"}


@pytest.mark.parametrize(
    ("answer", "problem"), [*ANSWERS.items(), (None, "--yes: is needed where standard input is not a terminal")]
)
def test_an_operator_confirms(run, monkeypatch, answer, problem):
    terminal = io.StringIO(answer or "")
    monkeypatch.setattr(terminal, "isatty", lambda: answer is not None)
    monkeypatch.setattr("sys.stdin", terminal)
    with lone_motors(_CHANNEL) as motors:
        status, _, complained = run("set-id", _CHANNEL, "14")
        assert (status, *_ids(motors, 3)) == ((2, 127) if problem else (0, 14))
    assert complained == (f"error: {problem}\n" if problem else "")
