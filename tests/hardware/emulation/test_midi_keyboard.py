import os
import time

import numpy as np

from humanoid_sim.hardware.emulation.midi_keyboard import MidiKeyboard, message


def keys(*down):
    values = np.zeros(88)
    values[list(down)] = 1.0
    return values


def test_changes_are_note_messages_with_running_status():
    assert message(keys(), keys()) == b""
    assert message(keys(), keys(0, 87)) == bytes((0x90, 21, 64, 108, 64))
    assert message(keys(39, 43), keys(40, 43)) == bytes((0x90, 60, 0, 61, 64))


def test_it_plays_on_a_fifo_and_says_that_it_is_there(tmp_path):
    state = [keys(39)]
    keyboard = MidiKeyboard(tmp_path / "keys", lambda: state[0])
    try:
        with open(keyboard.path, "rb", buffering=0) as stream:
            os.set_blocking(stream.fileno(), False)
            found = b""

            def heard(what):
                nonlocal found
                deadline = time.monotonic() + 30.0
                while what not in found:
                    assert time.monotonic() < deadline, found
                    found += stream.read() or b""
                    time.sleep(0.002)
                found = found.partition(what)[2]

            heard(bytes((0x90, 60, 64)))
            state[0] = keys()
            heard(bytes((0x90, 60, 0)))
            for _ in range(3):
                heard(b"\xfe")
            keyboard.close()
            assert stream.read().strip(b"\xfe") == b"", "its end"
    finally:
        keyboard.close()
    assert not keyboard.path.exists()
