"""Frames as text, and the load of a bus."""

from humanoid_sim.hardware.bus.frame import Frame, bus_load


def test_fourteen_motors_at_200_hz_fill_a_bus_to_what_the_protocol_notes_say():
    assert 0.73 < bus_load(200.0 * 2 * 14) < 0.90
    assert bus_load(0.0) == 0.0


def test_frames_print_as_candump_has_them():
    assert str(Frame(0x1FE, bytes(2))) == "000001FE#0000"
    assert str(Frame(0x1FE, b"\xab", is_extended=False)) == "1FE#AB"
