import pytest

from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot

_CHANNEL = "virtual:bench-param"


@pytest.fixture(scope="module", autouse=True)
def motors():
    """Motors of their own: these tests write to them."""
    with MockServer(load_robot("lite"), [_CHANNEL]) as motors:
        yield motors


@pytest.fixture
def values(run, table_rows):
    """Read parameters of a motor: exit status, and the first word of each value by name."""

    def read(*words):
        status, printed, _ = run("param", "get", _CHANNEL, *words)
        return status, {row[1]: row[2] for row in table_rows(printed)}

    return read


def test_all_parameters_with_a_name_are_read(values):
    status, found = values("15")
    assert status == 0
    assert len(found) == 29
    assert (found["run_mode"], found["limit_torque"], found["canTimeout"]) == ("0", "5.5", "0")


@pytest.mark.parametrize(
    ("words", "read"),
    [
        (("12", "vbus", "0x7026"), (0, {"VBUS": "48", "EPScan_time": "1"})),
    ],
)
def test_parameters_are_read_by_name_or_by_index_and_type(values, words, read):
    assert values(*words) == read


def test_a_value_is_written_verified_and_said(run, values):
    status, printed, _ = run("param", "set", _CHANNEL, "12", "canTimeout", "2000")
    assert status == 0
    assert printed == (f"motor 12 on {_CHANNEL}: canTimeout 0 (off) -> 2000 (100 ms), until power-off unless saved\n")
    assert run("param", "set", _CHANNEL, "12", "limit_torque", "12.1")[0] == 0  # no float32 is 12.1
    assert values("12", "limit_torque") == (0, {"limit_torque": "12.1"})


def test_saving_keeps_values_beyond_power_off(run, motors):
    run("param", "set", _CHANNEL, "14", "zero_sta", "1")
    status, printed, _ = run("param", "save", _CHANNEL, "14")
    assert (status, printed) == (0, f"motor 14 on {_CHANNEL}: saved\n")
