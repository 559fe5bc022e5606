import pytest
from lone_motor import cycle_power, lone_motors

from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot

_CHANNEL = "virtual:bench-set-id"


def _ids(motors, *indices):
    return [motors._motors.motors[i].can_id for i in indices]


def test_a_motor_from_the_factory_gets_its_id_and_keeps_it(run):
    with lone_motors(_CHANNEL) as motors:
        status, printed, complained = run("set-id", _CHANNEL, "14", "--yes")
        assert (status, complained) == (0, "")
        lines = printed.splitlines()
        assert lines[0].startswith(f"found motor 127 on {_CHANNEL}, unique id ")
        assert lines[0].endswith(", and no other")
        assert lines[1] == "motor 127 is now 14, read back and saved"
        assert lines[-1] == f"  python -m humanoid_sim.hardware ping {_CHANNEL} 14"
        assert _ids(motors, 3) == [14]
        cycle_power(motors)
        assert _ids(motors, 3) == [14]
        status, printed, _ = run("discover", _CHANNEL)
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


@pytest.mark.parametrize(("lines", "status"), [(("yes",), 0), (("y",), 2), ((), 2)])
def test_an_operator_confirms(run, types, lines, status):
    types(*lines)
    with lone_motors(_CHANNEL) as motors:
        ended, _, complained = run("set-id", _CHANNEL, "14")
        assert (ended, *_ids(motors, 3)) == (status, 127 if status else 14)
    assert ("not confirmed" in complained) == bool(status)


def test_without_a_terminal_it_says_how_to_go_on(run):
    with lone_motors(_CHANNEL) as motors:
        status, _, complained = run("set-id", _CHANNEL, "14")
        assert (status, _ids(motors, 3)) == (2, [127])
    assert "--yes: is needed" in complained
