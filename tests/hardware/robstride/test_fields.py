from humanoid_sim.hardware.bus.frame import Frame


def test_frames_print_as_candump_has_them():
    assert str(Frame(0x1FE, bytes(2))) == "000001FE#0000"
    assert str(Frame(0x1FE, b"\xab", is_extended=False)) == "1FE#AB"
