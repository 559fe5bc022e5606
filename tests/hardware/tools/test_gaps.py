"""For how long a tool is silent to a motor that it drives: a third of the motor's CAN timeout at most."""

import itertools
import threading
import time

import can
import pytest

from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robstride.enabling import CAN_TIMEOUT
from humanoid_sim.hardware.tools import identify as tool
from humanoid_sim.robots.description import load_robot

pytestmark = pytest.mark.soak

_NAP = 0.002
"""s"""


class _Listener:
    """Hears every frame of a virtual bus with its stamp, and notes when it was kept from looking."""

    def __init__(self, channel, on_frame=lambda _: None):
        self.frames, self.stalls = [], []
        self._on_frame = on_frame
        self._closing = threading.Event()
        self._bus = can.Bus(interface="virtual", channel=channel)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._closing.set()
        self._thread.join()
        self._bus.shutdown()

    def _run(self):
        while not self._closing.is_set():
            while (message := self._bus.recv(0.0)) is not None:
                if message.arbitration_id & 0xFF == 0x45 and not any(message.data):
                    continue  # gains of a Sito that is not driven yet
                self.frames.append((message.timestamp, message.arbitration_id))
                self._on_frame(message)
            before = time.time()
            time.sleep(_NAP)
            if (late := time.time() - before - _NAP) > 0.5 * _NAP:
                self.stalls.append((before, late))

    def gaps(self, feeds, begins, ends):
        """s between its commands, from enabling to stopping, without the time for which this machine stood still."""
        first = min(at for at, found in self.frames if begins(found))
        last = min(at for at, found in self.frames if ends(found) and at > first)
        fed = [at for at, found in self.frames if feeds(found) and first <= at <= last]
        assert len(fed) > 2
        return [
            end - begin - sum(late for at, late in self.stalls if begin - late <= at + _NAP and at < end)
            for begin, end in itertools.pairwise(fed)
        ]


def _robstride(*kinds):
    """Whether a frame to motor 15 is of one of these types."""
    return lambda found: found & 0xFF == 15 and found >> 24 in kinds


def _sito(*kinds):
    """Likewise for the Sito with id 16."""
    return lambda found: found >> 8 == 0x050610 and found & 0xFF in kinds


@pytest.mark.parametrize(
    ("words", "silent"),
    [
        (("identify", "left_wrist_yaw", "--yes"), "left_elbow_pitch"),
        (("identify", "left_wrist_yaw", "--yes"), "left_wrist_yaw"),
        (("identify", "left_wrist_roll", "--yes", "--robot", "lite_sito", "--allow-no-timeout"), "left_elbow_pitch"),
    ],
)
def test_no_tool_is_silent_to_a_motor_that_it_drives(run, monkeypatch, words, silent):
    """Also where its answers, or those of a motor that is asked for its position, are lost for a while."""
    monkeypatch.setattr(tool, "_RAMP", 0.2)
    monkeypatch.setattr(tool, "_HOLD", 0.05)
    monkeypatch.setattr(tool, "CAN_TIMEOUT", 2.0)  # a busy machine may stand still for longer than 0.1 s
    is_sito = "lite_sito" in words
    commands = _sito(0x09) if is_sito else _robstride(1)
    seen = []

    def lose_answers(message):
        if silent and commands(message.arbitration_id):
            seen.append(message)
            if len(seen) == 10:
                motors.inject(Fault("silent", (silent,), duration=0.25))

    with (
        MockServer(load_robot("lite_sito" if is_sito else "lite"), ["virtual:bench-gaps"]) as motors,
        _Listener("bench-gaps", lose_answers) as listener,
    ):
        status, _, _ = run(words[0], "virtual:bench-gaps", *words[1:])
        time.sleep(20 * _NAP)
    assert status == 0
    if is_sito:
        gaps = listener.gaps(commands, _sito(0x45), _sito(0x00))
    else:
        gaps = listener.gaps(commands, _robstride(3), _robstride(4))
    assert max(gaps) < CAN_TIMEOUT / 3.0
