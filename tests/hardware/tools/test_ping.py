import pytest

from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools.bench import motor_bench, read_value, write_value
from humanoid_sim.robots.description import load_robot

_CHANNEL = "virtual:bench-tools"


def _values(printed):
    lines = (line.split(maxsplit=1) for line in printed.splitlines() if line.startswith("  "))
    return {words[0]: words[1] for words in lines}


def test_a_motor_says_who_it_is_and_how_it_is(run, lite_motors):
    status, printed, complained = run("ping", _CHANNEL, "13", "--count", "3")
    values = _values(printed)
    assert (status, complained) == (0, "")
    assert printed.startswith(f"motor 13 on {_CHANNEL}, unique id ")
    assert values["answered"].startswith("3 of 3, median ")
    assert (values["run_mode"], values["VBUS"], values["canTimeout"]) == ("0", "48 V", "0 (off)")
    assert "position" not in values


def test_the_status_is_read_enabled_and_the_motor_left_stopped(run, lite_motors):
    status, printed, _ = run("ping", _CHANNEL, "13", "--count", "1", "--read-status")
    values = _values(printed)
    assert (status, values["model"]) == (0, "rs-00")
    assert (values["firmware"], values["faults"]) == ("0.0.3.255", "none")
    assert float(values["position"].split()[0]) == pytest.approx(float(values["mechPos"].split()[0]), abs=2e-3)
    assert abs(float(values["effort"].split()[0])) < 1e-3
    assert values["temperature"] == "25.0 °C"
    with motor_bench(_CHANNEL, 13, 0xFD) as channels:
        assert read_value(channels, PARAMETERS["canTimeout"]) == 0  # as before
        write_value(channels, PARAMETERS["zero_sta"], 0)
        assert channels.slots[0].sample.status.mode.name == "RESET"


def test_a_motor_in_another_run_mode_or_a_faulty_one_is_reported_and_left_stopped(run, inject):
    words = ("ping", "virtual:bench-ping", "13", "--count", "1", "--read-status")
    with MockServer(load_robot("lite"), ["virtual:bench-ping"]) as motors:
        with motor_bench("virtual:bench-ping", 13, 0xFD) as channels:
            write_value(channels, PARAMETERS["run_mode"], 2)
        status, printed, complained = run(*words)
        assert status == 2
        assert "motor 13 on virtual:bench-ping: run_mode is 2, expected 0: enabling may move it" in complained
        assert "temperature" not in printed
        with motor_bench("virtual:bench-ping", 13, 0xFD) as channels:
            write_value(channels, PARAMETERS["run_mode"], 0)
        inject(motors, Fault("motor_fault", ("left_shoulder_yaw",)))
        assert run(*words)[::2] == (
            2,
            "error: motor 13 on virtual:bench-ping: reports phase_overcurrent, phase_a_overcurrent\n",
        )
