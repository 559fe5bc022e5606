from __future__ import annotations

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride.fields import FaultBit, StatusFault, flag_names, join_identifier, split_identifier


def test_identifiers_split_and_join() -> None:
    assert split_identifier(0x02801BFD) == (2, 0x80, 0x1B, 0xFD)
    assert join_identifier(2, 0x80, 0x1B, 0xFD) == 0x02801BFD


def test_frames_print_as_candump_has_them() -> None:
    assert str(Frame(0x1FE, bytes(2))) == "000001FE#0000"
    assert str(Frame(0x1FE, b"\xab", is_extended=False)) == "1FE#AB"


def test_flags_are_named_and_unknown_bits_numbered() -> None:
    assert flag_names(StatusFault(0)) == ()
    assert flag_names(StatusFault.UNDERVOLTAGE | StatusFault.UNCALIBRATED) == ("undervoltage", "uncalibrated")
    assert flag_names(FaultBit(1 << 3 | 1 << 31)) == ("overvoltage", "bit31")
