import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.bus.events import BurstDetector, BusEvent, read_error_frame


def _controller(state):
    return bytes([0, state, 0, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ("error_class", "data", "event", "text"),
    [
        (0x040, bytes(8), BusEvent.DOWN, "bus-off"),
        (0x100, bytes(8), BusEvent.DOWN, "controller restarted after bus-off"),
        (0x020, bytes(8), BusEvent.ERROR, "no acknowledgement on transmission"),
        (0x008, bytes(8), BusEvent.ERROR, "protocol violation"),
        (0x001, bytes(8), BusEvent.ERROR, "transmit timeout"),
        (0x002, bytes(8), BusEvent.NORMAL, "arbitration lost"),
        (0x200, bytes(8), BusEvent.NORMAL, "error counters"),
        (0x004, _controller(0x02), BusEvent.TX_FULL, "controller's transmit buffer overflowed"),
        (0x004, _controller(0x01), BusEvent.ERROR, "controller's receive buffer overflowed"),
        (0x004, _controller(0x30), BusEvent.ERROR, "error-passive (receiving), controller is error-passive (transm"),
        (0x004, _controller(0x40), BusEvent.NORMAL, "controller is error-active again"),
        (0x004, b"", BusEvent.ERROR, "controller problem"),
        (0x042, bytes(8), BusEvent.DOWN, "bus-off, arbitration lost"),
        (0x000, bytes(8), BusEvent.ERROR, "error frame of an unknown class"),
    ],
)
def test_what_an_error_frame_says(error_class, data, event, text):
    found, errors = read_error_frame("socketcan", error_class, data)
    assert found is event
    assert text in ", ".join(errors)


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))
def test_any_error_frame_is_read(error_class, data):
    event, errors = read_error_frame("socketcan", error_class, data)
    assert errors
    if error_class & 0x40:
        assert event is BusEvent.DOWN


def test_the_bits_of_other_drivers_mean_nothing_here():
    assert read_error_frame("pcan", 0x42, bytes(8)) == (BusEvent.ERROR, ("error frame",)), "bus-off on SocketCAN"


def test_everything_that_a_frame_reports_is_counted_by_itself():
    _, errors = read_error_frame("socketcan", 0x00C, _controller(0x08))
    assert errors == ("protocol violation", "many transmit errors")


def test_ten_errors_within_a_fifth_of_a_second_are_a_burst_and_nine_are_none():
    burst = BurstDetector()
    assert [burst.add(0.02 * number) for number in range(11)] == [False] * 9 + [True, True]  # 10 within 0.18 s
    assert not burst.add(0.5), "the errors before are past"


def test_errors_that_a_bus_recovers_from_are_never_a_burst():
    burst = BurstDetector()
    assert not any(burst.add(0.025 * number) for number in range(1000))  # 40 a second
