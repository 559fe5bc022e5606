from __future__ import annotations

from humanoid_sim.hardware.bus.load import bus_load


def test_fourteen_motors_at_200_hz_fill_a_bus_to_what_the_protocol_notes_say() -> None:
    assert 0.73 < bus_load(200.0 * 2 * 14) < 0.90
    assert bus_load(0.0) == 0.0
