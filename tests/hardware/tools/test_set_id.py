import io

import pytest
from lone_motor import cycle_power, lone_motors

from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.robstride.messages import SetDeviceId
from humanoid_sim.hardware.robstride.requests import RobstrideLink
from humanoid_sim.robots.description import load_robot

pytestmark = pytest.mark.usefixtures("quick_search")


_CHANNEL = "virtual:bench-set-id"


def _ids(motors, *indices):
    return [motors._emulator.motors.states[i].can_id for i in indices]


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
    with VirtualMotors(load_robot("lite"), [_CHANNEL]) if whole else lone_motors(_CHANNEL, indices) as motors:
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


@pytest.mark.parametrize(("lost", "expected"), [(2, 0), (3, 2)])
def test_a_lost_frame_is_sent_again(run, monkeypatch, lost, expected):
    send, renames = RobstrideLink.send, []

    def send_not_always(self, commands):
        if isinstance(next(iter(commands.values()))[0], SetDeviceId):
            renames.append(1)
            if len(renames) <= lost:
                return
        send(self, commands)

    monkeypatch.setattr(RobstrideLink, "send", send_not_always)
    with lone_motors(_CHANNEL) as motors:
        status, _, complained = run("set-id", _CHANNEL, "14", "--yes")
        assert _ids(motors, 3) == [14 if expected == 0 else 127]
    assert status == expected
    if expected:
        assert complained.startswith("error: motor 127 did not become 14: now answers 127 (unique id ")


def test_what_saving_keeps_besides_is_told(run):
    with lone_motors(_CHANNEL):
        assert run("param", "set", _CHANNEL, "127", "canTimeout", "2000")[0] == 0
        status, _, complained = run("set-id", _CHANNEL, "14", "--yes")
    assert status == 0
    assert complained == (
        "warning: saving keeps canTimeout 2000 (100 ms) too (factory: 0 (off)); to avoid it, switch the motor off and "
        "on first\n"
    )


def test_status_3_and_advice_where_nobody_answers(run):
    status, _, complained = run("set-id", "virtual:nobody", "14", "--yes")
    assert status == 3
    assert complained.splitlines() == [
        "check: a virtual channel exists inside one program only; two share udp_multicast:239.74.163.2 (python -m "
        "humanoid_sim.hardware emulate --channel udp_multicast:239.74.163.2)",
        "error: no motor answers on virtual:nobody",
    ]
