import io
import time
from types import SimpleNamespace

import pytest

from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools import enabled_motor
from humanoid_sim.hardware.tools import identify as tool
from humanoid_sim.hardware.tools.bench import motor_bench, read_value, write_value

_CHANNEL = "virtual:bench-tools"
_WRIST = ("identify", _CHANNEL, "left_wrist_yaw", "--yes")


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(tool, "_RAMP", 0.12)
    monkeypatch.setattr(tool, "_HOLD", 0.05)
    monkeypatch.setattr(enabled_motor, "CAN_TIMEOUT", 2.0)  # a busy machine may stand still for longer than 0.1 s


def _is_stopped_as_before(motor_id):
    with motor_bench(_CHANNEL, motor_id, 0xFD) as channels:
        write_value(channels, PARAMETERS["zero_sta"], 0)
        sample = channels.slots[0].sample
        return read_value(channels, PARAMETERS["canTimeout"]) == 0 and sample.status.mode.name == "RESET"


def test_ctrl_c_in_the_middle_leaves_the_motor_stopped(run, lite_motors, monkeypatch):
    calls = []

    def interrupted(seconds):
        calls.append(seconds)
        if len(calls) == 5:
            raise KeyboardInterrupt
        time.sleep(seconds)

    monkeypatch.setattr(tool, "time", SimpleNamespace(monotonic=time.monotonic, sleep=interrupted))
    status, _, complained = run(*_WRIST)
    assert (status, complained) == (130, "interrupted\n")
    assert _is_stopped_as_before(15)


@pytest.mark.parametrize(("answer", "expected"), [("yes\n", 0), ("y\n", 2)])
def test_leave_is_asked_for_on_a_terminal(run, lite_motors, monkeypatch, answer, expected):
    terminal = io.StringIO(answer)
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdin", terminal)
    assert run(*_WRIST[:-1])[0] == expected
