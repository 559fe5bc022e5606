from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.robots.description import load_robot

Run = Callable[..., tuple[int, str, str]]
Rows = Callable[[str], list[list[str]]]
Values = Callable[..., tuple[int, dict[str, str]]]

_CHANNEL = "virtual:bench-param"


@pytest.fixture(scope="module", autouse=True)
def motors() -> Iterator[VirtualMotors]:
    """Motors of their own: these tests write to them."""
    with VirtualMotors(load_robot("lite"), [_CHANNEL]) as motors:
        yield motors


@pytest.fixture
def values(run: Run, table_rows: Rows) -> Callable[..., tuple[int, dict[str, str]]]:
    """Read parameters of a motor: exit status, and the first word of each value by name."""

    def read(*words: str) -> tuple[int, dict[str, str]]:
        status, printed, _ = run("param", "get", _CHANNEL, *words)
        return status, {row[1]: row[2] for row in table_rows(printed)}

    return read


def test_all_parameters_with_a_name_are_read(values: Values) -> None:
    status, found = values("15")
    assert status == 0
    assert len(found) == 29
    assert (found["run_mode"], found["limit_torque"], found["canTimeout"]) == ("0", "5.5", "0")
    assert found["damper"] == "not"  # there, on an rs-05


def test_named_parameters_are_read(values: Values) -> None:
    assert values("12", "vbus", "0x7026") == (0, {"VBUS": "48", "EPScan_time": "1"})


def test_an_index_without_a_name_is_read_with_its_type(values: Values) -> None:
    assert values("12", "0x3022", "--type", "u32") == (0, {"0x3022": "0"})


def test_status_1_where_a_motor_has_no_such_parameter(values: Values) -> None:
    assert values("12", "0x3999", "--type", "f32") == (1, {"0x3999": "not"})


def test_a_value_is_written_verified_and_said(run: Run, values: Values) -> None:
    status, printed, _ = run("param", "set", _CHANNEL, "12", "canTimeout", "2000")
    assert status == 0
    assert printed == (f"motor 12 on {_CHANNEL}: canTimeout 0 (off) -> 2000 (100 ms), until power-off unless saved\n")
    assert run("param", "set", _CHANNEL, "12", "limit_torque", "12.1")[0] == 0  # no float32 is 12.1
    assert values("12", "limit_torque") == (0, {"limit_torque": "12.1"})


def test_a_value_that_the_motor_does_not_take_is_an_error(run: Run) -> None:
    status, _, complained = run("param", "set", _CHANNEL, "15", "damper", "0")  # an rs-05 has none
    assert status == 2
    assert complained == f"error: motor 15 on {_CHANNEL}: damper reads nothing after 0 was written\n"


def test_a_function_code_is_what_it_is_in_the_motors_model(run: Run) -> None:
    at = ("param", "set", _CHANNEL, "15")
    assert run(*at, "0x3017", "1", "--type", "f32") == (
        2,
        "",
        "error: 0x3017: is mechVel of an rs-05, which is read only\n",
    )
    assert run(*at, "0x3022", "0", "--type", "u32")[2] == (
        "error: 0x3022: is fault_word of an rs-05, which is read only\n"
    )
    assert run(*at, "0x200C", "1e9", "--type", "u32")[2] == (
        "error: stored canTimeout: is 1e+09, expected 0 to 100000\n"
    )
    assert run(*at, "0x200B", "1e9", "--type", "u32", "--model", "rs-04")[2] == (
        "error: stored canTimeout: is 1e+09, expected 0 to 100000\n"
    )
    assert run(*at, "0x200C", "2000", "--type", "f32")[2] == "error: --type: is f32, stored canTimeout is a u32\n"


@pytest.mark.parametrize(
    ("motor", "value", "peak"), [("15", "5.6", "5.5 N·m for an rs-05"), ("12", "14.5", "14 N·m for an rs-00")]
)
def test_a_torque_limit_is_within_the_models_peak(run: Run, values: Values, motor: str, value: str, peak: str) -> None:
    before = values(motor, "limit_torque")
    status, _, complained = run("param", "set", _CHANNEL, motor, "limit_torque", value)
    assert (status, complained) == (2, f"error: limit_torque: is {value}, expected 0 to {peak}\n")
    assert values(motor, "limit_torque") == before
    status, _, complained = run("param", "set", _CHANNEL, motor, "limit_torque", value, "--model", "rs-02")
    assert (status, complained) == (0, "")  # whoever knows better says so
    run("param", "set", _CHANNEL, motor, "limit_torque", before[1]["limit_torque"])


def test_saving_keeps_values_beyond_power_off(run: Run, motors: VirtualMotors) -> None:
    run("param", "set", _CHANNEL, "14", "zero_sta", "1")
    status, printed, _ = run("param", "save", _CHANNEL, "14")
    assert (status, printed) == (0, f"motor 14 on {_CHANNEL}: saved\n")


def test_status_3_where_the_motor_is_silent(run: Run) -> None:
    status, _, complained = run("param", "set", _CHANNEL, "40", "zero_sta", "1")
    assert status == 3
    assert complained == f"error: motor 40 does not answer on {_CHANNEL}\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("set", "mechPos", "1"), "mechPos: is read only"),
        (("set", "zero_sta", "0.5"), "zero_sta: is 0.5, expected a whole number of type u8"),
        (("set", "limit_torque", "nan"), "limit_torque: is nan, expected a finite float32"),
        (("set", "limit_torque", "-5"), "limit_torque: is -5, expected 0 to 120 N·m for any model"),
        (("set", "limit_torque", "18", "--model", "rs-02"), "limit_torque: is 18, expected 0 to 17 N·m for an rs-02"),
        (("set", "limit_torque", "1", "--model", "rs-22"), "unknown motor model 'rs-22'; known: "),
        (("set", "canTimeout", "1e9"), "canTimeout: is 1e+09, expected 0 to 100000"),
        (("set", "0x07028", "1e9", "--type", "u32"), "canTimeout: is 1e+09, expected 0 to 100000"),
        (("set", "0b111000000011000", "200", "--type", "f32"), "limit_cur: is 200, expected 0 to 90 A for any model"),
        (("set", "0o70013", "-5", "--type", "f32"), "limit_torque: is -5, expected 0 to 120 N·m for any model"),
        (("set", "0x07019", "1", "--type", "f32"), "mechPos: is read only"),
        (("set", "0x7028", "5", "--type", "f32"), "--type: is f32, canTimeout is a u32"),
        (("set", "run_mode", "9"), "run_mode: is 9, expected 0, 1, 2, 3, 5"),
        (("set", "EPScan_time", "0"), "EPScan_time: is 0, expected 1 to 65535"),
        (("set", "cur_filter_gain", "1.5"), "cur_filter_gain: is 1.5, expected 0 to 1"),
        (("set", "damper", "1"), "damper: is 1, expected 0"),
        (("get", "speed"), "unknown parameter 'speed'; known: run_mode"),
        (("get", "0x3022"), "--type: is needed for 0x3022, which has no name here"),
        (("get", "0x13022", "--type", "u8"), "parameter: is 0x13022, expected an index of 0 to 0xFFFF"),
        (("get", "VBUS", "--type", "u8"), "--type: is u8, VBUS is a f32"),
    ],
)
def test_options_that_are_not_accepted(run: Run, words: tuple[str, ...], message: str) -> None:
    action, *rest = words
    status, _, complained = run("param", action, _CHANNEL, "12", *rest)
    assert status == 2
    assert message in complained
    assert complained.count("\n") == 1
