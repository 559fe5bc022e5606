"""Commands to Sito motors as frames: gains come in frames of their own, which may be lost."""

from types import SimpleNamespace

import numpy as np
import pytest

from humanoid_sim.hardware.can_bus import NEVER
from humanoid_sim.hardware.motor_link import LinkTerms, Motor
from humanoid_sim.hardware.sito.motors import SitoMotors
from humanoid_sim.hardware.sito.protocol import Command, Feedback, Gains, PositionFeedback, decode, encode
from humanoid_sim.robots.motors import MOTORS

MODEL = MOTORS["TA40-50"]


class Rig:
    """Motors 22, 23, … on one channel, and the messages of each command."""

    def __init__(self, count=2):
        self.sent = []
        self.channel = channel = SimpleNamespace(
            send=lambda frames, _: self.sent.append(frames), sent=0, intruder=NEVER
        )
        line = SimpleNamespace(channels=(channel,), sources=("can0",), clock=lambda: 0.0)
        group = [Motor(str(motor_id), 0, motor_id, MODEL) for motor_id in range(22, 22 + count)]
        self.motors = SitoMotors(line, group, LinkTerms(0.1, 0.02))
        self.count = count

    def command(self, stiffness, damping=1.0, position=0.0):
        self.motors.command(np.tile([[position], [0.0], [0.0], [stiffness], [damping]], (1, self.count)))
        return [decode(frame, MODEL) for _, frame in self.sent[-1]]

    def kinds(self, *values):
        return [type(message) for message in self.command(*values) if message.device_id == 22]


def test_stiffer_gains_go_after_the_command_and_softer_ones_before():
    """So that no target is ever held with gains that were not meant for it."""
    rig = Rig()
    assert rig.kinds(20.0) == [Command, Gains], "from the zero gains of enabling"
    assert rig.kinds(50.0) == [Command, Gains]
    assert rig.kinds(0.0) == [Gains, Command]


def test_gains_go_with_every_command():
    """A lost frame of gains is made good in the next period."""
    rig = Rig(4)
    for stiffness in (20.0, 20.0, 0.0, 0.0):
        found = rig.command(stiffness, 2.0)
        assert sorted((m.device_id, type(m).__name__) for m in found) == [
            (i, kind) for i in range(22, 26) for kind in ("Command", "Gains")
        ]


def test_the_position_of_a_damping_command_is_where_the_motor_is():
    """Were the frame with the gains lost, the old K_p would meet the new command's position."""
    rig = Rig(1)
    for message in (Feedback(22, 0.1, 0.2), PositionFeedback(22, 0.25)):
        assert rig.motors.receive(0, encode(message, MODEL), 1.0)
    (command,) = [m for m in rig.command(0.0, 2.0) if isinstance(m, Command)]
    assert command.position == pytest.approx(0.25, abs=1e-4)
    reading = rig.motors.readings()
    assert (reading.position[0], reading.velocity[0]) == pytest.approx((0.25, 0.1), abs=1e-4)
